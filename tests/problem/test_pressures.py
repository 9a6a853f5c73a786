"""Pressures as loads: their stresses and resultants, and what is refused with its key."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pressed_square import BOTH_DEGREES
from problems import block

from contact_locking import solve
from contact_locking.study_file import from_mapping

pytestmark = pytest.mark.serial


@BOTH_DEGREES
@pytest.mark.parametrize("dim", [2, 3])
def test_equal_pressures_on_all_free_sides_give_the_hydrostatic_stress(
    dim: int, degree: int
) -> None:
    held = ["left", "bottom"] if dim == 2 else ["left", "front", "bottom"]
    free = ["right", "top"] if dim == 2 else ["right", "back", "top"]
    rollers = [
        {"on": name, "value": [0 if axis == other else None for other in range(dim)]}
        for axis, name in enumerate(held)
    ]
    solution = solve(
        block(
            dim,
            0.5,
            loads={"pressures": [{"on": free, "value": 0.03}], "displacements": rollers},
            contact=[],
            discretisation={"degree": degree},
            material__locking_limit=math.inf,
        )
    )
    assert solution.converged
    stress = solution.elastic_stress.x.array.reshape(-1, dim, dim)
    assert np.abs(stress + 0.03 * np.eye(dim)).max() < 1e-9


def test_the_resultant_of_a_pressure_on_a_quarter_circle_is_exact() -> None:
    parameters = from_mapping(
        {
            "mesh": {"builder": "annulus", "quarter": True, "h": 0.3},
            "loads": {
                "pressures": [{"on": "inner", "value": 0.02}],
                "displacements": [
                    {"on": "left", "value": [0, None]},
                    {"on": "bottom", "value": [None, 0]},
                ],
            },
            "contact": [],
            "certificate": {"error_bound": True},
        }
    )
    summary = solve(parameters).summary
    geometry: Any = parameters.mesh.geometry
    # The polygon of the facets has the end points of the arc.
    wanted = [0.02 * geometry.inner_radius] * 2
    assert summary["converged"]
    assert summary["certificate"]["resultants"]["loads"] == pytest.approx(wanted, rel=1e-9)
    assert summary["certificate"]["errors"]["guaranteed"]["applicable"]
