"""The reactions of named parts of the boundary add up, and balance the loads."""

from __future__ import annotations

import math

import numpy as np
import pytest
from problems import BOTH_DEGREES, square

from contact_locking import solve


@BOTH_DEGREES
def test_the_reactions_of_all_parts_add_up_to_those_of_the_certificate(degree: int) -> None:
    # Left and top share a node, which both of them hold in both directions.
    loads = {
        "body_force": [0.01, -0.02],
        "displacements": [
            {"on": ["left", "top"], "value": [0.001, -0.002]},
            {"on": "right", "value": [None, "-0.002*y"]},
        ],
    }
    solution = solve(square(loads=loads, discretisation={"degree": degree}))
    found = solution.summary["reactions"]
    assert solution.converged
    assert list(found) == ["left", "top", "right"]
    assert found["right"][0] == 0.0
    total = np.sum(list(found.values()), axis=0)
    wanted = solution.summary["certificate"]["resultants"]["reactions"]
    assert total == pytest.approx(wanted, rel=1e-12, abs=1e-15)


def test_a_support_pushes_back_with_the_load_that_it_carries() -> None:
    # Rollers below and on the left, a pressure of 0.03 above: the support below carries all of it.
    loads = {
        "pressures": [{"on": "top", "value": 0.03}],
        "displacements": [
            {"on": "left", "value": [0, None]},
            {"on": "bottom", "value": [None, 0]},
        ],
    }
    summary = solve(square(loads=loads, contact=[])).summary
    assert summary["reactions"]["bottom"] == pytest.approx([0.0, 0.03], abs=1e-10)
    assert summary["reactions"]["left"] == pytest.approx([0.0, 0.0], abs=1e-10)


def test_a_sheet_that_locks_has_the_reactions_of_a_formula() -> None:
    """Strain (0, M) beside the eigenstrain (e_0, e_0), and no stress along y."""
    young, nu, limit, swelling = 2.0, 0.3, 0.02, 0.0199
    summary = solve(
        square(
            mesh={"builder": "block", "h": 0.4, "size": [1.0, 0.7]},
            material={
                "elasticity": {"young": young, "poisson": nu},
                "plane": "stress",
                "eigenstrain": {"value": swelling},
                "locking_limit": limit,
            },
            loads={
                "displacements": [
                    {"on": ["left", "right"], "value": [0, None]},
                    {"on": "bottom", "value": [None, 0]},
                ]
            },
            contact=[],
            penalty={"n": math.inf},
        )
    ).summary
    wanted = 0.7 * young / (1.0 - nu**2) * abs(nu * limit - (1.0 + nu) * swelling)
    assert summary["reactions"]["left"][0] == pytest.approx(wanted, rel=1e-6)
