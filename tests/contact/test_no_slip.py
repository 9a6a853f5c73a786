"""Contact without slip: what is pressed onto the foundation stays where it is."""

from __future__ import annotations

import itertools
import math
from copy import deepcopy
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import with_changes
from scipy.sparse.linalg import splu
from sweep.discrete import discretise
from two_bodies import stack

from contact_locking import InputError, solve, solve_steps
from contact_locking.results.contact_points import OPEN, SLIP, STICK
from contact_locking.results.solution import StudySolution
from contact_locking.study_file.parameters import Parameters

_BLOCK: dict[str, Any] = {
    "mesh": {"builder": "block", "size": [2, 1], "h": 0.25},
    "material": {"elasticity": {"young": 1.0, "poisson": 0.49}},
    "loads": {"displacements": [{"on": "top", "value": [0.004, -0.02]}]},
    "contact": {"on": "bottom"},
    "friction": {"coefficient": math.inf},
}
_CYLINDER: dict[str, Any] = {
    "mesh": {"builder": "block", "size": [4, 1], "h": 0.2},
    "loads": {"displacements": [{"on": "bottom", "value": ["0.2*t", 0]}]},
    "contact": {"on": "top", "foundation": {"cylinder": {"centre": [2, 2.95], "radius": 2}}},
    "friction": {"coefficient": math.inf},
    "steps": {"to": 1, "count": 3},
}


def _holds(found: StudySolution) -> bool:
    return all(item["holds"] for item in found.summary["certificate"]["criteria"].values())


def _given(data: dict[str, Any], **changes: Any) -> Parameters:
    return with_changes(deepcopy(data), **changes)


@pytest.mark.parametrize("degree", [1, 2])
def test_a_block_that_is_pressed_everywhere_is_as_good_as_clamped(degree: int) -> None:
    element = {"discretisation__degree": degree}
    found = solve(_given(_BLOCK, **element))
    assert found.converged and _holds(found)
    assert found.summary["slip_area"] == 0.0 and found.summary["friction_used"] is None
    held = [*_BLOCK["loads"]["displacements"], {"on": "bottom", "value": [0, 0]}]
    clamped = solve(_given(_BLOCK, loads={"displacements": held}, contact=[], **element))
    reaction = clamped.summary["reactions"]["bottom"]
    summary = found.summary
    force = np.add(summary["contact_force"], summary["friction_force"])
    assert force == pytest.approx(reaction, rel=1e-6)


def test_what_touches_sticks_and_what_leaves_is_free() -> None:
    """The same as with a coefficient at which nothing slips either."""
    found = list(solve_steps(_given(_CYLINDER)))
    assert all(solution.converged for solution in found)
    finite = {"coefficient": 100, "smoothing": {"kernel": "none"}}
    other = list(solve_steps(_given(_CYLINDER, friction=finite)))
    for one, two in zip(found, other, strict=True):
        assert one.summary["slip_area"] == two.summary["slip_area"] == 0.0
        difference = one.displacement.x.array - two.displacement.x.array
        largest = MPI.COMM_WORLD.allreduce(np.abs(two.displacement.x.array).max(), MPI.MAX)
        assert np.abs(difference).max() < 1e-6 * largest
    points = found[-1].contact_points
    if points is not None:
        assert set(points.state) == {OPEN, STICK}
        is_open = points.state == OPEN
        sizes = np.linalg.norm(points.traction, axis=1)
        assert sizes[is_open].max() < 1e-5 * points.pressure.max()


def test_a_strip_that_is_lifted_at_one_end_stays_in_its_place() -> None:
    """Nothing else holds it along the foundation."""
    loads = {"body_force": [0, -1e-3], "displacements": [{"on": "right", "value": [None, 0.02]}]}
    mesh = {"builder": "block", "size": [6, 1], "h": 0.25}
    found = solve(_given(_BLOCK, loads=loads, mesh=mesh))
    assert found.converged and found.summary["slip_area"] == 0.0
    assert 0.0 < found.summary["contact_area"] < 6.0


def test_a_rough_floor_beside_a_wall_with_friction() -> None:
    """At the corner the wall's pressure and the floor's friction would hold each other up."""
    contact = [{"on": "bottom"}, {"on": "left", "friction": {"coefficient": 0.3}}]
    push = [{"on": "right", "value": [-0.02, 0]}]
    held = [{"on": "top", "value": [0.002, -0.01]}]
    loads = {"displacements": held, "tractions": push}
    found = solve(_given(_BLOCK, loads=loads, contact=contact))
    assert found.converged and _holds(found)
    points = found.contact_points
    if points is not None:
        floor, wall = points.parts()
        assert SLIP not in floor.state and SLIP in wall.state
        assert wall.pressure.max() < 1.0


def _beams(h: float) -> Parameters:
    """Two beams of length 4, held at the left; the upper one presses the lower one down."""
    beam = [4.0, 1.0]
    return stack(
        2,
        h,
        mesh__upper=beam,
        mesh__size=beam,
        loads__displacements=[{"on": ["left", "upper_left"], "value": [0.0, 0.0]}],
        loads__tractions=[{"on": "top", "value": [0.0, -1e-5]}],
        friction__coefficient=math.inf,
        solver__max_friction_updates=2,
        solver__max_iterations=20,
        # The sets are those of the linear theory.
        contact__pair="once",
    )


@pytest.mark.serial
def test_beams_are_solved_from_what_a_large_coefficient_presses() -> None:
    """Of the 4096 sets one is right, without the node beside the support."""
    found = solve(_beams(0.5), MPI.COMM_SELF)
    assert found.converged and _holds(found)
    points = found.contact_points
    assert points is not None
    assert points.state.tolist() == [OPEN, OPEN] + [STICK] * 11
    assert points.pressure[1] == 0.0
    assert np.linalg.norm(points.traction[1]) <= 1e-6 * points.pressure.max()


@pytest.mark.serial
def test_two_beams_without_slip_may_have_no_set_of_pressed_nodes() -> None:
    """Each set sticks; a node of it pulls, or one beside it enters the other beam."""
    given = _beams(0.9)
    found = solve(given, MPI.COMM_SELF)
    assert not found.converged
    discrete = discretise(given, found.domain, found.displacement.function_space)
    contact, free = discrete.contact, discrete.free
    assert contact is not None
    seen = contact.seen[:, free].toarray().reshape(-1, 2, free.sum())[contact.decides]
    normals = contact.normals[contact.decides]
    along = np.stack([normals, normals @ [[0.0, 1.0], [-1.0, 0.0]]], axis=1)
    jumps = np.einsum("kcd,kdj->ckj", along, seen).reshape(-1, free.sum())
    solved = splu(discrete.stiffness.tocsc()[free][:, free]).solve
    alone, compliance = jumps @ solved(discrete.load[free]), jumps @ solved(jumps.T)
    count = len(normals)
    assert 2**count == 128
    assert np.abs(contact.gap[contact.decides]).max() < 1e-15
    for pressed in itertools.product([False, True], repeat=count):
        is_pressed = np.array(pressed)
        held = np.flatnonzero(np.tile(is_pressed, 2))
        forces = np.zeros(2 * count)
        forces[held] = np.linalg.solve(compliance[np.ix_(held, held)], alone[held])
        depth = (alone - compliance @ forces)[:count]
        pulls, enters = forces[:count][is_pressed], depth[~is_pressed]
        assert pulls.min(initial=0.0) < 0.0 or enters.max(initial=0.0) > 1e-6 * abs(alone).max()


def test_a_body_that_is_not_found_to_hold_without_slip_is_told_nothing_of_a_coefficient() -> None:
    """A pressure of 1e-5 beside a shear of 0.0035, which is in equilibrium without any slip."""
    given = _given(
        _BLOCK,
        mesh={"builder": "block", "h": 0.25, "structured": True},
        material__elasticity={"young": 1.0, "poisson": 0.0},
        loads={
            "tractions": [
                {"on": "top", "value": [0.0035, -1e-5]},
                {"on": "right", "value": [0.0, 0.0035]},
                {"on": "left", "value": [0.0, -0.0035]},
            ]
        },
    )
    summary = solve(given, MPI.COMM_SELF).summary
    assert not summary["converged"]
    for text in (summary["reason"], summary["suggestion"]):
        assert text and "friction" not in text and "coefficient" not in text


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"solver__method": "newton", "penalty__n": 1e3}, "take solver.method: interior_point"),
        ({"friction__coefficient": "inf if x < 1 else 0.3"}, "unknown name 'inf'"),
        ({"friction__coefficient": -math.inf}, "must be"),
        ({"friction__coefficient": math.nan}, "must be a finite number"),
    ],
)
def test_where_it_cannot_be_the_message_says_what_to_write(
    changes: dict[str, Any], told: str
) -> None:
    with pytest.raises((InputError, ValueError)) as caught:
        _given(_BLOCK, **changes)
    assert told in str(caught.value)
