"""Foundations on springs.

Those with known answers are in tests/verification/test_verification_free_foundations.py.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from pressed_tools import HELD, NONE, UP, pressed, told
from problems import solved

from contact_locking import InputError, solve
from contact_locking.certificate.balances import equilibrium
from contact_locking.running.solving import SolvableStudy
from contact_locking.study.assembly import assemble

PRESSED = {
    "tractions": [{"on": "right", "value": [-0.01, 0.003]}],
    "displacements": [{"on": "bottom", "value": [0.0, 0.01]}],
}


def held(on: str = "top", mu: float = 0.3, **foundation: Any) -> dict[str, Any]:
    """A contact whose foundation is a plane above a unit block, by default."""
    friction = {"coefficient": mu, "smoothing": NONE}
    return {"on": on, "foundation": {"half_space": UP, **foundation}, "friction": friction}


# Springs.


@pytest.mark.serial
def test_a_spring_alone_holds_a_body_that_is_free_to_move() -> None:
    loads = {
        "body_force": [0.0, -0.01],
        "displacements": [{"on": "left", "value": [0.0, None]}],
    }
    floor: dict[str, Any] = {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}}
    for n in (math.inf, 1e3):
        spring = {"stiffness": 0.5, "along": [0.0, 1.0]}
        on_springs = held("bottom", mu=0.0, spring=spring, **floor)
        found = solved(pressed(on_springs, n, loads=loads))
        assert told(found)["travel"] == pytest.approx(-0.01 / 0.5, rel=1e-7)


@pytest.mark.serial
def test_a_motion_drives_the_far_end_of_a_spring() -> None:
    place = {"point": [0.0, 1.5], "normal": [0.0, -1.0]}
    spring = {"stiffness": 2.0, "along": [0.0, 1.0]}
    driven = solved(
        pressed(held(half_space=place, motion=[0.0, -0.53], spring=spring), loads=PRESSED)
    )
    near = {"point": [0.0, 0.97], "normal": [0.0, -1.0]}
    there = solved(pressed(held(half_space=near, spring=spring), loads=PRESSED))
    for key in ("travel", "spring_force"):
        assert told(driven)[key] == pytest.approx(told(there)[key], rel=1e-6)
    assert told(driven)["travel"] < 0.0


@pytest.mark.serial
def test_a_spring_that_nothing_touches_stays_where_it_is() -> None:
    far = {"point": [0.0, 1.5], "normal": [0.0, -1.0]}
    spring = {"stiffness": 2.0, "along": [0.0, 1.0]}
    found = solved(pressed(held(half_space=far, spring=spring)))
    assert told(found)["travel"] == pytest.approx(0.0, abs=1e-9)
    rest = solved(pressed(held(spring=spring), loads={"displacements": HELD}))
    assert told(rest)["travel"] == 0.0


@pytest.mark.serial
def test_ranks_and_linear_solvers_find_the_same_place(comm: MPI.Intracomm) -> None:
    contact = held(spring={"stiffness": 2.0}, force=[0.0, -0.01])
    alone = solved(pressed(contact, loads=PRESSED), MPI.COMM_SELF)
    others = [
        solved(pressed(contact, loads=PRESSED), comm),
        solved(pressed(contact, loads=PRESSED, solver__linear="iterative"), comm),
    ]
    travels = [told(one)["travel"] for one in (alone, *others)]
    assert travels == pytest.approx([travels[0]] * 3, rel=1e-5)


@pytest.mark.serial
def test_derivatives_by_the_stiffness_of_a_spring_are_those_of_more_solves() -> None:
    contact = held(spring={"stiffness": 2.0}, force=[0.0, -0.01])
    asked = {
        "of": ["contacts.0.tool.travel"],
        "to": ["contact.foundation.spring.stiffness"],
        "check": True,
    }
    found = solved(pressed(contact, loads=PRESSED, h=0.5, sensitivities=asked))
    for entries in found.summary["sensitivities"].values():
        for entry in entries.values():
            assert entry["derivative"] == pytest.approx(entry["checked"], rel=1e-4)


@pytest.mark.serial
@pytest.mark.parametrize("limit", [math.inf, 0.012])
def test_a_plate_with_much_friction_is_one_that_is_glued_to_the_body(limit: float) -> None:
    """The force that a glued plate takes moves a pressed plate as far, while nothing lifts off."""
    mesh = {"builder": "block", "h": 0.25, "structured": True, "cells": "box"}
    material = {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": limit}
    given: dict[str, Any] = {"mesh": mesh, "material": material}
    moved = [*HELD, {"on": "top", "value": [0.0, -0.01]}]
    glued = solved(pressed([], loads={"displacements": moved}, **given))
    force = glued.summary["reactions"]["top"][1]
    plate = held(mu=1e3, force=[0.0, force])
    found = solved(pressed(plate, loads={"displacements": HELD}, **given))
    u, w = glued.displacement.x.array, found.displacement.x.array
    assert np.abs(u - w).max() <= 1e-5 * np.abs(u).max()
    assert told(found)["travel"] == pytest.approx(0.01, rel=1e-5)


# What is refused.


@pytest.mark.serial
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"spring": {"stiffness": 2.0, "along": [1.0, 0.0]}}, "along the surface"),
        ({"spring": {"stiffness": 2.0}}, "direction in which the spring gives way"),
        ({"spring": {"stiffness": 0.0, "along": [0.0, 1.0]}}, "stiffness"),
        (
            {"force": [0.0, -1.0], "spring": {"stiffness": 2.0, "along": [0.0, 1.0]}},
            "acts along force",
        ),
    ],
)
def test_a_foundation_that_nothing_would_stop_is_refused(
    changes: dict[str, Any], words: str
) -> None:
    with pytest.raises((InputError, ValueError), match=words):
        solve(pressed(held(**changes)))


@pytest.mark.serial
def test_a_wrong_force_breaks_the_balance_of_the_tool() -> None:
    problem = assemble(pressed(held(force=[0.0, -0.03]), h=0.5), MPI.COMM_WORLD)
    solver = SolvableStudy(problem).solver
    state = solver.state(solver.solve())
    tolerance = solver.settings.tolerance
    assert equilibrium(state).criteria(tolerance)["tool_balance"].holds
    fields = state.contacts[0]
    fields.pressure = fields.pressure * (1.0 + 1e-4)
    assert not equilibrium(state).criteria(tolerance)["tool_balance"].holds
