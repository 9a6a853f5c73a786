"""Rigid motions that the data do not make, and pressures that are small but not rounding."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial


def _block(loads: dict[str, Any], gap: float = 0.0, friction: float = 0.5, **mesh: Any) -> Any:
    return {
        "mesh": {"builder": "block", "dim": 2, "h": 0.2} | mesh,
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
        "loads": loads,
        "contact": {"on": "bottom", "gap": gap},
        "friction": {"coefficient": friction, "smoothing": {"kernel": "none"}},
    }


_LET_GO = _block(
    {
        "tractions": [{"on": "right", "value": [1e-3, 0.0]}],
        "supports": [{"on": "left", "along": [1.0, -0.2]}],
    },
    friction=0.0,
) | {
    "contact": [
        {"on": "bottom"},
        {
            "on": "top",
            "foundation": {
                "half_space": {"point": [0, 1], "normal": [0, -1]},
                "force": [0, "-(0.01*sin(pi*t))"],
            },
        },
    ],
    "penalty": {"n": 100.0},
}


def _pulled(pull: float, pressure: float, unit: float) -> dict[str, Any]:
    """A traction along the foundation, its moment balanced by those of the sides."""
    values = {"top": [pull, -pressure], "right": [0.0, pull], "left": [0.0, -pull]}
    return {
        "tractions": [
            {"on": on, "value": [unit * component for component in value]}
            for on, value in values.items()
        ]
    }


def _solution(data: dict[str, Any]) -> StudySolution:
    return solving.solve(Parameters.model_validate(data))


@pytest.mark.parametrize("unit", [1e-20, 1.0, 1e9])
def test_a_pull_that_exceeds_the_friction_is_refused_in_any_unit(unit: float) -> None:
    """Far away from the foundation rounding in u exceeds the loads, which still do not balance."""
    data = _block(_pulled(0.0131985, 0.0091526, unit))
    if unit > 1.0:
        data["material"]["elasticity"]["young"] = unit
    found = _solution(data)
    assert not found.converged
    assert "friction cannot hold the body" in found.summary["reason"]


# It takes minutes on two ranks.
@pytest.mark.parametrize(
    ("friction", "what"),
    [pytest.param(0.5, "friction", marks=pytest.mark.serial), (0.0, "contact")],
)
def test_a_body_that_its_support_leads_off_the_foundation_is_refused(
    friction: float, what: str
) -> None:
    """At t = 1 nothing presses any more, and the pull leads along the rollers and up."""
    loads = {
        "tractions": [{"on": "top", "value": [0.002, "-(0.02*sin(pi*t))"]}],
        "supports": [{"on": "left", "along": [1.0, -0.3]}],
    }
    data = _block(loads, friction=friction) | {"steps": {"times": [0.5, 1.0]}}
    *_, before, last = solving.solve_steps(Parameters.model_validate(data))
    assert before.converged
    assert not last.converged
    assert f"{what} cannot hold the body" in last.summary["reason"]
    assert "translation along x and y" in last.summary["reason"]


@pytest.mark.parametrize("linear", ["direct", "iterative"])
def test_a_body_that_its_tool_lets_go_of_is_refused_however_far_the_tool_follows(
    linear: str,
) -> None:
    """The rollers lead the body up as soon as the tool does not press any more."""
    data = _LET_GO | {"steps": {"times": [0.5, 1.0], "least": 0.25}, "solver": {"linear": linear}}
    *_, before, last = solving.solve_steps(Parameters.model_validate(data))
    assert before.converged, before.summary["reason"]
    assert not last.converged
    assert "contact cannot hold the body" in last.summary["reason"]


@pytest.mark.parametrize("unit", [1e-20, 1.0])
def test_a_pull_below_the_friction_is_held(unit: float) -> None:
    found = _solution(_block(_pulled(0.003, 0.00915, unit)))
    assert found.converged, found.summary["reason"]
    forces = np.add(found.summary["contact_force"], found.summary["friction_force"])
    np.testing.assert_allclose(forces, [-0.003 * unit, 0.00915 * unit], rtol=1e-6)
