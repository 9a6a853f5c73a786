"""Derivatives that a study file asks for."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from problems import block

import contact_locking as cl
from contact_locking.inverse.sensitivities import in_rows, number_at, value_of, with_number
from contact_locking.running.solving import solve
from contact_locking.solver.monitor import Monitor
from contact_locking.study_file.dump import plain

SHARP = {"tolerance": 1e-10, "friction_tolerance": 1e-11}
OF = ["compliance", "contact_force.1", "reactions.left.0"]


def study(**changes: Any) -> cl.Parameters:
    return block(
        h=0.25,
        **{
            "parameters": {"mu0": 0.3, "s0": 0.05},
            "friction__coefficient": "mu0*exp(-s/s0)",
            "friction__smoothing__radius": 0.3,
            "penalty__n": math.inf,
            "material__locking_limit": 0.03,
            "contact__gap": 0.002,
            "solver": SHARP,
            **changes,
        },
    )


@pytest.mark.serial
def test_names_stand_for_their_numbers() -> None:
    places, slip = np.zeros((2, 1)), np.array([0.05])
    for parameters, mu0 in ((study(), 0.3), (with_number(study(), "parameters.mu0", 0.4), 0.4)):
        mu = parameters.friction.coefficient
        assert mu is not None and mu == "mu0*exp(-s/s0)"
        assert mu.at(places, s=slip) == pytest.approx(mu0 * np.exp(-1.0))


@pytest.mark.serial
@pytest.mark.parametrize(
    ("name", "reason"),
    [("x", "is already"), ("sin", "is already"), ("2a", "not a valid name")],
)
def test_a_name_that_expressions_cannot_use_is_refused(name: str, reason: str) -> None:
    with pytest.raises(cl.InputError, match=reason):
        cl.from_mapping({"parameters": {name: 1.0}})


@pytest.mark.serial
@pytest.mark.parametrize(
    ("key", "reason"),
    [
        ("mesh.h", "smoothly"),
        ("friction.coefficient", "section parameters"),
        ("penalty.n", "infinite"),
        ("contact.on", "no number"),
        ("contact.gaps", "not given"),
        ("mu0", "did you mean 'parameters.mu0'"),
    ],
)
def test_a_key_without_a_derivative_is_refused(key: str, reason: str) -> None:
    with pytest.raises(cl.InputError, match=reason):
        number_at(study(), key)


def differences(parameters: cl.Parameters, key: str, width: float = 1e-4) -> np.ndarray[Any, Any]:
    at = number_at(parameters, key)
    found = []
    for side in (width, -width):
        other = solve(with_number(parameters, key, at * (1.0 + side)))
        found.append(np.array([value_of(name, other) for name in OF]))
    return (found[0] - found[1]) / (2.0 * width * at)


def judge(parameters: cl.Parameters, keys: list[str]) -> None:
    asked = with_changes_of(parameters, {"of": OF, "to": keys})
    solution = solve(asked)
    for key in keys:
        expected = differences(parameters, key)
        found = [solution.summary["sensitivities"][name][key]["derivative"] for name in OF]
        least = 1e-2 * np.array([abs(value_of(name, solution)) for name in OF])
        size = np.maximum(np.abs(expected), least / number_at(parameters, key))
        assert np.all(np.abs(found - expected) <= 2e-4 * size), (key, found, expected)


def with_changes_of(parameters: cl.Parameters, sensitivities: dict[str, Any]) -> cl.Parameters:
    return cl.from_mapping(plain(parameters) | {"sensitivities": sensitivities})


def test_a_study_has_its_derivatives_in_the_summary() -> None:
    judge(study(), ["parameters.mu0", "contact.gap", "material.locking_limit"])


def test_friction_remembers_the_derivatives_of_its_slips() -> None:
    parameters = study(
        loads={"displacements": [{"on": "top", "value": ["0.02*sin(3*t)", "-0.02-0.01*t"]}]},
        steps={"to": 1, "count": 3},
        material__locking_limit=math.inf,
    )
    asked = with_changes_of(parameters, {"of": ["reactions.top.0"], "to": ["parameters.s0"]})
    solution = solve(asked)
    found = solution.summary["sensitivities"]["reactions.top.0"]["parameters.s0"]
    sides = [
        value_of("reactions.top.0", solve(with_number(parameters, "parameters.s0", value)))
        for value in (0.05 * (1.0 + 1e-4), 0.05 * (1.0 - 1e-4))
    ]
    expected = (sides[0] - sides[1]) / (2e-4 * 0.05)
    assert found["derivative"] == pytest.approx(expected, rel=1e-4)


def test_bodies_that_touch_each_other_have_the_derivatives_of_differences() -> None:
    """Both lock at the corners, and the upper one slides on the lower one."""
    of = ["contact_force.1", "friction_force.0", "reactions.bottom.1"]
    to = ["parameters.mu", "material.locking_limit", "contact.gap"]
    found = solve(
        cl.from_mapping(
            {
                "parameters": {"mu": 0.05},
                "mesh": {"builder": "stack", "size": [1, 0.5], "upper": [1, 0.5], "h": 0.25},
                "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.04},
                "loads": {
                    "displacements": [
                        {"on": "top", "value": [0.01, -0.03]},
                        {"on": "bottom", "value": [0, 0]},
                    ]
                },
                "contact": {
                    "on": "upper_bottom",
                    "against": "lower_top",
                    "gap": 0.001,
                    "pair": "once",
                },
                "friction": {"coefficient": "mu", "smoothing": {"radius": 0.3}},
                "penalty": {"n": math.inf},
                "solver": SHARP,
                "sensitivities": {"of": of, "to": to, "check": True},
            }
        )
    )
    assert found.summary["slip_area"] > 0.5 and found.summary["limit_used"] > 0.999
    for name in of:
        table = found.summary["sensitivities"][name]
        for key in to:
            size = 1e-2 * abs(value_of(name, found))
            expected = pytest.approx(table[key]["checked"], rel=1e-3, abs=1e-3 * size)
            assert table[key]["derivative"] == expected, (name, key)


class Told(Monitor):
    """Keeps the messages of a solve."""

    def __init__(self) -> None:
        self.messages: list[str] = []

    def message(self, text: str) -> None:
        self.messages.append(text)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("of", "to", "reason"),
    [
        ("complience", "contact.gap", r"no quantity 'complience'.*compliance"),
        ("locked_fraction", "contact.gap", "count of points"),
        ("reactions.botom.1", "contact.gap", "no quantity"),
        ("reactions.left.2", "contact.gap", "no quantity"),
        ("compliance", "mesh.h", "smoothly"),
    ],
)
@pytest.mark.parametrize("changes", [{}, {"steps": {"to": 1, "count": 2}}])
def test_what_has_no_derivative_is_refused_before_the_solve(
    of: str, to: str, reason: str, changes: dict[str, Any]
) -> None:
    told = Told()
    asked = with_changes_of(study(**changes), {"of": [of], "to": [to]})
    with pytest.raises(cl.InputError, match=reason):
        solve(asked, monitor=told)
    assert not [text for text in told.messages if "certificate" in text]
    with pytest.raises(cl.InputError, match=reason):
        cl.check(asked)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("drag", "steps", "sign"), [(0.5, None, -1.0), ("1 - abs(2*t - 1)", {"times": [0.5, 1.0]}, 1.0)]
)
def test_a_block_that_slides_has_the_derivative_of_coulombs_law(
    drag: float | str, steps: dict[str, Any] | None, sign: float
) -> None:
    """A plate drags a block, there or there and back: friction is mu times the pressing force."""
    parameters = with_changes_of(
        study(
            friction__coefficient="mu0",
            friction__smoothing={"kernel": "none"},
            loads={"displacements": [{"on": "top", "value": [drag, -0.01]}]},
            material={},
            contact__gap=0.0,
            steps=steps,
        ),
        {"of": ["friction_force.0", "contact_force.1"], "to": ["parameters.mu0"]},
    )
    solution = solve(parameters)
    summary = solution.summary
    assert summary["slip_area"] == pytest.approx(1.0)
    friction, force = summary["friction_force"][0], summary["contact_force"][1]
    found = {name: entry["parameters.mu0"] for name, entry in summary["sensitivities"].items()}
    # F = -mu N on the way there, of which N changes with mu as well.
    expected = sign * (force + 0.3 * found["contact_force.1"]["derivative"])
    assert friction == pytest.approx(sign * 0.3 * force, rel=1e-6)
    assert found["friction_force.0"]["derivative"] == pytest.approx(expected, rel=1e-6)


@pytest.mark.serial
def test_a_support_that_turns_takes_its_reaction_along() -> None:
    of = ["reactions.left.0", "reactions.left.1", "contact_force.1", "compliance"]
    key = "loads.supports.0.along.1"
    support = {"on": "left", "along": [1.0, 0.4], "value": 0.002}
    held = study(
        loads={
            "displacements": [{"on": "right", "value": [0.0, 0.0]}],
            "supports": [support],
            "tractions": [{"on": "top", "value": [0.0, -0.05]}],
        },
        sensitivities={"of": of, "to": [key], "check": True},
    )
    summary = solve(held).summary
    for name in of:
        found = summary["sensitivities"][name][key]
        assert found["derivative"] == pytest.approx(found["checked"], rel=1e-3), name


@pytest.mark.serial
def test_forces_of_springs_have_derivatives_with_those_of_conditions_beside_them() -> None:
    of = ["reactions.left.0", "reactions.left.1", "reactions.top.1"]
    to = ["loads.springs.0.stiffness", "loads.springs.1.stiffness", "loads.tractions.0.value.1"]
    found = solve(
        study(
            loads={
                "displacements": [{"on": "left", "value": [0.001, None]}],
                "springs": [
                    {"on": "left", "stiffness": 0.5},
                    {"on": "top", "stiffness": 0.1, "along": [1, 2]},
                ],
                "tractions": [{"on": "right", "value": [0.0, -0.004]}],
            },
            sensitivities={"of": of, "to": to, "check": True},
        )
    )
    table = found.summary["sensitivities"]
    for name in of:
        derivatives = np.array([table[name][key]["derivative"] for key in to])
        checked = np.array([table[name][key]["checked"] for key in to])
        assert derivatives == pytest.approx(checked, rel=1e-3, abs=1e-3 * np.abs(checked).max())
        assert np.abs(checked).max() > 0.0


@pytest.mark.serial
def test_a_result_that_is_zero_has_no_elasticity() -> None:
    young = "material.elasticity.young"
    pressed = study(
        loads={"displacements": [{"on": "top", "value": [0.0, -0.01]}]},
        friction__coefficient=0.0,
        parameters=None,
    )
    asked = {"of": ["compliance", "contact_force.1"], "to": [young]}
    summary = solve(with_changes_of(pressed, asked)).summary
    found = [summary["sensitivities"][name][young]["elasticity"] for name in asked["of"]]
    assert found[0] is None and found[1] == pytest.approx(1.0, abs=1e-6)
    assert len(in_rows(summary)) == 2
