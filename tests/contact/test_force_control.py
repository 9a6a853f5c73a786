"""Foundations that a force pushes or a spring holds, with their travel as one more unknown."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import HELD, NONE, UP, column, pressed, solved, told, tool
from slow import slow

from contact_locking import InputError, Parameters, assemble, solve, solve_steps
from contact_locking.certificate.balances import equilibrium
from contact_locking.running.solving import SolvableStudy


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("n", [1e3, math.inf])
def test_the_force_on_a_column_gives_the_strain_of_uniaxial_compression(dim: int, n: float) -> None:
    area, distance, epsilon, limit = 1.0, 0.5, 1e-4, 0.02
    plane = {"point": [0.0] * (dim - 1) + [2.0 + distance], "normal": [0.0] * (dim - 1) + [-1.0]}
    rollers = column(dim).loads.displacements
    stands = {"on": ["bottom"], "value": [None] * (dim - 1) + [0.0]}
    for force in (0.01, 0.05):
        push = tool([0.0] * (dim - 1) + [-force], mu=0.0, half_space=plane)
        loads = {"displacements": [*(item.model_dump() for item in rollers), stands]}
        found = solved(column(dim, contact=push, loads=loads, penalty={"n": n, "epsilon": epsilon}))
        lame, shear = 0.3 / (1.3 * 0.4), 1.0 / 2.6
        strain = force / area / (lame + 2.0 * shear)
        if strain > limit:
            # sigma = (lambda + 2 mu) eps + 2 n (eps - M)
            more = 0.0 if n == math.inf else (strain - limit) / (1.0 + 2.0 * n / (lame + 2 * shear))
            strain = limit + more
        assert found.summary["strain_norm_max"] == pytest.approx(strain, rel=1e-7)
        travel = distance + 2.0 * strain + epsilon * force / area
        assert told(found)["travel"] == pytest.approx(travel, rel=1e-9)
        assert found.summary["contact_force"][-1] == pytest.approx(-force, rel=1e-8)


@pytest.mark.serial
def test_two_tools_press_from_both_sides_with_their_own_forces() -> None:
    left = tool([0.02, 0.0], "left", half_space={"point": [-0.1, 0.0], "normal": [1.0, 0.0]})
    right = tool([-0.03, 0.0], "right", half_space={"point": [1.2, 0.0], "normal": [-1.0, 0.0]})
    found = solved(pressed([left, right], loads={"displacements": HELD}))
    forces = [
        np.add(entry["contact_force"], entry["friction_force"])[0]
        for entry in found.summary["contacts"]
    ]
    assert forces == pytest.approx([0.02, -0.03], rel=1e-7)
    assert told(found, 0)["direction"] == [1.0, 0.0]
    assert told(found, 1)["direction"] == [-1.0, 0.0]
    # Both reach the body, and the stronger push goes farther beyond.
    beyond = [told(found, i)["travel"] - gap for i, gap in enumerate((0.1, 0.2))]
    assert 0.0 < beyond[0] < beyond[1] < 0.05


@pytest.mark.parametrize("weight", [0.017, 0.019])
def test_a_pinch_holds_a_weight_up_to_twice_the_friction_of_a_tool(weight: float) -> None:
    sides = [
        tool([0.03 * side, 0.0], on, half_space={"point": [x, 0.0], "normal": [side, 0.0]})
        for on, x, side in (("left", 0.0, 1.0), ("right", 1.0, -1.0))
    ]
    loads = {
        "body_force": [0.0, -weight],
        "displacements": [{"on": "bottom", "value": [0.0, None]}],
    }
    found = solve(pressed(sides, loads=loads))
    # 2 mu F = 0.018
    if weight < 0.018:
        assert found.converged, found.summary["reason"]
        assert found.summary["friction_force"][1] == pytest.approx(weight, rel=1e-7)
    else:
        assert not found.converged
        assert "translation along y" in found.summary["reason"]


# Duality gaps of 1e-8 of the energy allow differences of 1e-4 in the norm of the energy.
SAME = 1e-5


@pytest.mark.serial
@pytest.mark.parametrize("n", [1e3, math.inf])
def test_the_found_travel_gives_the_same_state_as_a_foundation_that_stands_there(n: float) -> None:
    pushed = solved(pressed(tool([0.0, -0.03]), n))
    place = {"point": [0.0, 1.0 - told(pushed)["travel"]], "normal": [0.0, -1.0]}
    still = tool([], half_space=place)
    del still["foundation"]["force"]
    fixed = solved(pressed(still, n))
    # Friction acts along the foundation, which has not moved along itself.
    u, w = (found.displacement.x.array for found in (pushed, fixed))
    assert np.abs(u - w).max() <= SAME * np.abs(w).max()
    for key in ("contact_force", "friction_force"):
        assert pushed.summary[key] == pytest.approx(fixed.summary[key], rel=SAME, abs=1e-8)


def test_several_ranks_find_what_one_finds(comm: MPI.Intracomm) -> None:
    parameters = pressed([tool([0.004, -0.03]), tool([0.02, 0.0], "left", half_space={
        "point": [-0.1, 0.0], "normal": [1.0, 0.0]})])  # fmt: skip
    together, alone = solved(parameters, comm), solved(parameters, MPI.COMM_SELF)
    for number in range(2):
        travels = told(together, number)["travel"], told(alone, number)["travel"]
        assert travels[0] == pytest.approx(travels[1], rel=1e-6)
    assert together.summary["contact_force"] == pytest.approx(
        alone.summary["contact_force"], rel=1e-6
    )


@pytest.mark.serial
def test_a_wrong_force_or_travel_breaks_the_balance_of_the_tool() -> None:
    problem = assemble(pressed(tool([0.0, -0.03]), h=0.5), MPI.COMM_WORLD)
    solver = SolvableStudy(problem).solver
    state = solver.state(solver.solve())
    (pushed,) = solver.system.tools
    tolerance = solver.settings.tolerance
    assert equilibrium(state).criteria(tolerance)["tool_balance"].holds
    pushed.force *= 1.0 + 1e-5
    assert not equilibrium(state).criteria(tolerance)["tool_balance"].holds
    pushed.force /= 1.0 + 1e-5
    fields = state.contacts[0]
    fields.pressure = fields.pressure * (1.0 - 1e-5)
    assert not equilibrium(state).criteria(tolerance)["tool_balance"].holds


def cycle(**changes: Any) -> Parameters:
    """A tool that presses, is dragged by a load on the body, and lets go."""
    loads = {
        "tractions": [{"on": "right", "value": ["-0.012*t", 0.0]}],
        "displacements": HELD,
    }
    force = [0.0, "-0.03*sin(pi*t)"]
    times = {"times": [0.0, 0.25, 0.5, 0.75, 1.0]}
    given: dict[str, Any] = {"loads": loads, "steps": times, "h": 0.5}
    return pressed(tool(force), **(given | changes))


@pytest.mark.serial
@pytest.mark.parametrize("n", [slow(1e3), math.inf])
def test_the_work_of_a_force_is_stored_or_dissipated(n: float) -> None:
    found = list(solve_steps(cycle(n=n)))
    assert all(one.converged for one in found), found[-1].summary["reason"]
    history = found[-1].history
    force, travel = history.column("tool_force"), history.column("tool_travel")
    assert force == pytest.approx(0.03 * np.sin(np.pi * history.column("t")), abs=1e-12)
    # Without a force the tool touches the body and presses with nothing.
    for one in (found[0], found[-1]):
        assert one.summary["contact_area"] == 0.0
        assert one.summary["contact_force"] == [0.0, 0.0]
    assert travel[-1] < travel[0] < travel[2]
    fields = found[-1].contacts[0]
    assert float(np.max(fields.u_normal - fields.gap, initial=-1.0)) <= 0.0
    rest = history.column("work") - np.diff(history.column("stored"), prepend=0.0)
    rest -= history.column("dissipated") + history.column("numerical")
    assert np.abs(rest).max() <= 1e-12
    assert (history.column("numerical") >= -1e-12).all()
    # Without another load the work is F dq alone.
    alone = list(solve_steps(cycle(n=n, loads={"displacements": HELD})))[-1].history
    expected = alone.column("tool_force") * np.diff(alone.column("tool_travel"), prepend=0.0)
    assert alone.column("work") == pytest.approx(expected, rel=1e-6, abs=1e-10)


@pytest.mark.serial
@pytest.mark.parametrize("n", [1e3, math.inf])
def test_a_tool_that_is_pushed_down_and_led_across_drags_the_body(n: float) -> None:
    """The plane presses with its force while its motion slides it along the body."""
    led = tool([0.0, -0.02], mu=0.3)
    led["foundation"]["motion"] = ["0.05*t", 0.0]
    given = pressed(led, n, loads={"displacements": HELD}, steps={"to": 1.0, "count": 2}, h=0.5)
    found = list(solve_steps(given))
    assert all(one.converged for one in found), found[-1].summary["reason"]
    assert found[-1].summary["contact_force"][1] == pytest.approx(-0.02, rel=1e-7)
    # In the end all of the tool slides over the body, which it drags with mu F.  Regularised
    # friction misses its bound by (delta/slip)^2/2.
    share = 1e-6 if n == math.inf else 2e-3
    assert found[-1].summary["friction_force"][0] == pytest.approx(0.3 * 0.02, rel=share)
    history = found[-1].history
    assert history.column("work").sum() > 0.3 * 0.02 * 0.02


@pytest.mark.serial
def test_a_motion_along_the_force_is_refused() -> None:
    led = tool([0.0, -0.02])
    led["foundation"]["motion"] = [0.0, "-0.01*t"]
    with pytest.raises(InputError, match="is along foundation"):
        assemble(pressed(led, steps={"to": 1.0, "count": 2}), MPI.COMM_WORLD)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("force", "why"),
    [
        ([0.0, 0.03], "does not push the foundation towards the body"),
        ([0.03, 0.0], "does not push the foundation towards the body"),
        ([0.0, "0*t"], "is zero at all times"),
        (["t", -1.0], "has another direction at t = 1"),
        ([0.0, "1.5*t - 1"], "changes its sign at t = 1"),
        ([0.0, "1/(t - 0.5)"], "contact.foundation.force"),
    ],
)
def test_a_force_that_cannot_push_is_refused(force: list[Any], why: str) -> None:
    given = pressed(tool(force), steps={"to": 1.0, "count": 2})
    with pytest.raises(InputError) as raised:
        assemble(given, MPI.COMM_WORLD)
    assert why in f"{raised.value.key}: {raised.value}"


@pytest.mark.serial
@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_a_body_that_only_tools_hold_is_refused(mu: float) -> None:
    below = {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}}
    two = [tool([0.0, -0.03], mu=mu), tool([0.0, 0.03], "bottom", mu=mu, **below)]
    with pytest.raises(InputError, match="body and foundations can move together"):
        assemble(pressed(two, loads={}), MPI.COMM_WORLD)


@pytest.mark.serial
def test_what_the_gap_and_the_tool_cannot_stop_is_still_infeasible() -> None:
    apart = [*HELD, {"on": "right", "value": ["0.1*y", None]}]
    found = solve(pressed(tool([0.0, -0.03]), loads={"displacements": apart}))
    assert not found.converged
    assert found.summary["reason"].startswith("infeasible")


PRESSED = {
    "tractions": [{"on": "right", "value": [-0.01, 0.003]}],
    "displacements": [{"on": "bottom", "value": [0.0, 0.01]}],
}


def held(on: str = "top", mu: float = 0.3, **foundation: Any) -> dict[str, Any]:
    """A contact whose foundation is a plane above a unit block, by default."""
    friction = {"coefficient": mu, "smoothing": NONE}
    return {"on": on, "foundation": {"half_space": UP, **foundation}, "friction": friction}


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
