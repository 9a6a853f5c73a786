"""Pressures as loads: their stresses and resultants, and what is refused with its key."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pressed_square import BOTH_DEGREES, square
from problems import block

from contact_locking import InputError, solve
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


@BOTH_DEGREES
def test_a_pressure_on_a_flat_side_is_the_traction_along_minus_its_normal(degree: int) -> None:
    more = {"discretisation": {"degree": degree}, "certificate__error_bound": degree == 1}
    held = [{"on": "right", "value": [0, 0]}]
    tractions = [{"on": "top", "value": [0, "-0.04 - 0.02*x"]}, {"on": "left", "value": [-0.01, 0]}]
    found = solve(square(**more))
    wanted = solve(square(loads={"tractions": tractions, "displacements": held}, **more))
    assert found.converged
    largest = np.abs(wanted.displacement.x.array).max(initial=0.0)
    difference = found.displacement.x.array - wanted.displacement.x.array
    assert np.abs(difference).max(initial=0.0) <= 1e-9 * largest + 1e-15
    errors = [one.summary["certificate"]["errors"] for one in (found, wanted)]
    if degree == 1:
        first, second = (entry["guaranteed"] for entry in errors)
        assert first["applicable"]
        assert first["energy_norm"] == pytest.approx(second["energy_norm"], rel=1e-6)


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


def test_a_pressure_that_is_not_finite_is_refused_with_its_key() -> None:
    loads = {
        "pressures": [{"on": "top", "value": "0.01*log(x - 0.5)"}],
        "displacements": [{"on": "right", "value": [0, 0]}],
    }
    with pytest.raises(InputError) as caught:
        solve(square(loads=loads))
    assert caught.value.key == "loads.pressures.0.value"
