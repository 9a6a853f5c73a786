"""Foundations on springs, and foundations that turn about a point until the moments balance.

Those with known answers are in tests/verification/test_verification_free_foundations.py.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI
from pressed_tools import HELD, NONE, UP, pressed, solved, told
from problems import block

import contact_locking as cl
from contact_locking import InputError, StudySolution, solve, solve_steps
from contact_locking.certificate.balances import equilibrium
from contact_locking.contact.free_motions import Turn
from contact_locking.monitor import Monitor
from contact_locking.process.of_study import solver_of
from contact_locking.study.assembly import assemble

PRESSED = {
    "tractions": [{"on": "right", "value": [-0.01, 0.003]}],
    "displacements": [{"on": "bottom", "value": [0.0, 0.01]}],
}
LAWS = [(math.inf, "auto"), (1e3, "newton"), (1e3, "interior_point")]


def held(on: str = "top", mu: float = 0.3, **foundation: Any) -> dict[str, Any]:
    """A contact whose foundation is a plane above a unit block, by default."""
    friction = {"coefficient": mu, "smoothing": NONE}
    return {"on": on, "foundation": {"half_space": UP, **foundation}, "friction": friction}


def turned(solution: StudySolution, number: int = 0) -> dict[str, Any]:
    """The entry of the summary about the tilt of a foundation."""
    return dict(solution.summary["contacts"][number]["tilt"])


# Springs.


def test_a_spring_alone_holds_a_body_that_is_free_to_move() -> None:
    """The weight compresses the spring, and the tilt bears the moment of the weight."""
    loads = {"body_force": [0.0, -0.01], "tractions": [{"on": "right", "value": [0.0, -0.002]}]}
    floor: dict[str, Any] = {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}}
    for n, method in LAWS:
        on_springs = held(
            "bottom",
            spring={"stiffness": 0.5, "along": [0.0, 1.0]},
            tilt={"about": [0.5, 0.0], "stiffness": 0.3},
            **floor,
        )
        found = solved(pressed(on_springs, n, loads=loads, solver__method=method))
        assert told(found)["travel"] == pytest.approx(-0.012 / 0.5, rel=1e-7)
        assert turned(found)["angle"] == pytest.approx(-0.001 / 0.3, rel=1e-7)
        assert turned(found)["moment"] == pytest.approx(0.001, rel=1e-7)


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


def test_a_spring_that_nothing_touches_stays_where_it_is() -> None:
    far = {"point": [0.0, 1.5], "normal": [0.0, -1.0]}
    spring = {"stiffness": 2.0, "along": [0.0, 1.0]}
    found = solved(pressed(held(half_space=far, spring=spring)))
    assert told(found)["travel"] == pytest.approx(0.0, abs=1e-9)
    rest = solved(pressed(held(spring=spring), loads={"displacements": HELD}))
    assert told(rest)["travel"] == 0.0


# Tilts.


def test_a_ball_joint_turns_about_the_axes_that_move_the_plane() -> None:
    """A plane of any direction does not spin about its normal; its axes are unit vectors."""
    for normal in ((0.0, 0.0, -1.0), (1.0, 1.0, -1.0), (0.1, -0.2, -1.0)):
        unit = np.array(normal) / np.linalg.norm(normal)
        foundation = {
            "half_space": {"point": [0.5, 0.5, 1.0], "normal": normal},
            "force": (0.01 * unit).tolist(),
            "tilt": {"about": [0.5, 0.5, 1.0]},
        }
        friction = {"coefficient": 0.0, "smoothing": NONE}
        contact = {"on": "top", "foundation": foundation, "friction": friction}
        loads = {"displacements": [{"on": "bottom", "value": [0.0] * 3}]}
        problem = assemble(block(3, 0.5, contact=contact, loads=loads), MPI.COMM_WORLD)
        axes = np.array([item.axis for item in problem.data.tools if isinstance(item, Turn)])
        assert len(axes) == 2
        assert axes @ axes.T == pytest.approx(np.eye(2), abs=1e-12)
        assert axes @ unit == pytest.approx(np.zeros(2), abs=1e-12)


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_newton_and_the_interior_point_method_find_the_same_tilt(mu: float) -> None:
    contact = held(
        mu=mu, spring={"stiffness": 2.0}, force=[0.0, -0.01], tilt={"about": [0.45, 1.0]}
    )
    ways = [solved(pressed(contact, n, loads=PRESSED, solver__method=m)) for n, m in LAWS[1:]]
    angles, travels = [turned(one)["angle"] for one in ways], [told(one)["travel"] for one in ways]
    assert angles[0] == pytest.approx(angles[1], rel=1e-7)
    assert travels[0] == pytest.approx(travels[1], rel=1e-7)


def test_an_iterative_solver_and_several_ranks_find_the_same_tilt(comm: MPI.Intracomm) -> None:
    contact = held(force=[0.0, -0.02], tilt={"about": [0.45, 1.0]})
    alone = solved(pressed(contact, loads=PRESSED), MPI.COMM_SELF)
    others = [
        solved(pressed(contact, loads=PRESSED), comm),
        solved(pressed(contact, loads=PRESSED, solver__linear="iterative"), comm),
    ]
    for found in others:
        assert turned(found)["angle"] == pytest.approx(turned(alone)["angle"], rel=1e-5)
        assert told(found)["travel"] == pytest.approx(told(alone)["travel"], rel=1e-5)


def test_a_foundation_tilts_over_steps_with_friction_and_keeps_the_energy() -> None:
    contact = held(force=[0.0, "-0.08*t*(1-t)"], tilt={"about": [0.45, 1.0]})
    loads = {
        "tractions": [{"on": "right", "value": ["-0.01*t", "0.003*t"]}],
        "displacements": [{"on": "bottom", "value": ["0.01*sin(6*t)", 0.0]}],
    }
    *_, last = solve_steps(pressed(contact, loads=loads, steps={"to": 1.0, "count": 4}))
    assert last.converged, last.summary["reason"]
    history = last.history
    assert np.all(history.column("energy_defect") <= 1e-12)
    assert np.all(history.column("tilt_moment") == 0.0)
    assert history.column("tilt_angle")[0] != 0.0


@pytest.mark.parametrize("n", [1e3, math.inf])
def test_the_found_place_gives_the_same_state_as_a_foundation_that_stands_there(n: float) -> None:
    """The normals stay those at rest, so that forces are right but for the share of the angle."""
    loads = {
        "tractions": [{"on": "right", "value": [-0.001, 0.0003]}],
        "displacements": [{"on": "bottom", "value": [0.0, 0.001]}],
    }
    contact = held(mu=0.0, force=[0.0, -0.001], tilt={"about": [0.45, 1.0]})
    free = solved(pressed(contact, n, loads=loads, h=0.5))
    angle, travel = turned(free)["angle"], told(free)["travel"]
    place = {
        "point": [0.45, 1.0 - travel],
        "normal": [math.sin(angle), -math.cos(angle)],
    }
    still = solved(pressed(held(mu=0.0, half_space=place), n, loads=loads, h=0.5))
    u, w = (found.displacement.x.array for found in (free, still))
    assert np.abs(u - w).max() <= 2.0 * abs(angle) * np.abs(w).max()
    assert still.summary["contact_force"][1] == pytest.approx(-0.001, rel=4.0 * abs(angle))


def test_a_foundation_settles_from_anywhere_and_its_border_is_the_derivative() -> None:
    """``q(u)`` is the root of g, and ``dq = -C^-1 B . du``."""
    contact = held(force=[0.003, -0.03], tilt={"about": [0.45, 1.0], "stiffness": 0.01})
    problem = assemble(pressed(contact, 1e3), MPI.COMM_WORLD)
    solver = solver_of(problem, Monitor())
    system = solver.system
    system.set_penalty(problem.penalty)
    own = system.tools[0].contact
    random = np.random.default_rng(1)
    x = system.u.function_space.tabulate_dof_coordinates()[:, :2]
    system.u.x.array[:] = 0.01 * np.sin(x @ random.normal(size=(2, 2)) * 3.0).reshape(-1)
    system.bounds[own] = np.full(len(own.free), 0.02)
    places = []
    for start in ((0.0, 0.0), (-3.0, 0.7), (5.0, -2.0)):
        system.tools.travels = start
        system.tools.settle(system.u)
        places.append(system.tools.travels)
    for other in places[1:]:
        assert other == pytest.approx(places[0], rel=1e-9, abs=1e-12)
    ((_, tractions, corner),) = system.tools.borders(system.u, 0.0)
    assert np.all(np.linalg.eigvalsh(corner) > 0.0)
    change = 1e-7 * np.cos(5.0 * x).reshape(-1)
    owned = own.surface.vector_space.dofmap.index_map.size_local * 2
    pushed = [
        system.comm.allreduce(float(own.surface.nodal_forces(part)[:owned] @ change[:owned]))
        for part in tractions
    ]
    expected = -np.linalg.solve(corner, pushed)
    before = np.array(system.tools.travels)
    system.u.x.array[:] += change
    system.tools.settle(system.u)
    assert np.array(system.tools.travels) - before == pytest.approx(expected, rel=1e-3)


def test_a_wrong_moment_breaks_the_balance_of_the_tool() -> None:
    contact = held(force=[0.0, -0.03], tilt={"about": [0.45, 1.0]})
    problem = assemble(pressed(contact, h=0.5), MPI.COMM_WORLD)
    solver = solver_of(problem, Monitor())
    state = solver.state(solver.solve())
    tolerance = solver.settings.tolerance
    assert equilibrium(state).criteria(tolerance)["tool_balance"].holds
    fields = state.contacts[0]
    arm = fields.surface.points[:, 0] - 0.45
    # The force stays, and the moment about the pivot does not.
    fields.pressure = fields.pressure * (1.0 + 1e-4 * (arm > 0.0) - 1e-4 * (arm < 0.0))
    assert not equilibrium(state).criteria(tolerance)["tool_balance"].holds


def test_derivatives_by_spring_and_pivot_are_those_of_more_solves() -> None:
    keys = ("spring.stiffness", "tilt.about.0")
    contact = held(
        spring={"stiffness": 2.0},
        force=[0.0, -0.01],
        tilt={"about": [0.45, 1.0], "stiffness": 0.01},
    )
    asked = {
        "of": ["contacts.0.tool.travel", "contacts.0.tilt.angle"],
        "to": [f"contact.foundation.{key}" for key in keys],
        "check": True,
    }
    found = solved(pressed(contact, loads=PRESSED, h=0.5, sensitivities=asked))
    for entries in found.summary["sensitivities"].values():
        for entry in entries.values():
            assert entry["derivative"] == pytest.approx(entry["checked"], rel=1e-4)


def test_a_script_has_springs_and_tilts_as_a_study_has() -> None:
    contact = held(force=[0.0, -0.01], tilt={"about": [0.45, 1.0]}, spring={"stiffness": 2.0})
    study = solved(pressed(contact, loads={"displacements": HELD}))
    domain, space = study.domain, study.displacement.function_space
    top, bottom = (domain.facets((name,), name) for name in ("top", "bottom"))
    fixed = fem.locate_dofs_topological(space, 1, bottom)
    k = fem.Constant(domain.mesh, 2.0)
    problem = cl.ContactProblem(
        cl.Elasticity(young=1.0, poisson=0.3),
        bcs=[fem.dirichletbc(np.zeros(2), fixed, space)],
        limits=[cl.StrainBall(0.02)],
        contacts=[
            cl.Contact(
                top,
                cl.HalfSpace((0.0, 1.0), (0.0, -1.0)),
                cl.Coulomb(0.3, cl.Local()),
                force=cl.Force((0.0, -0.01)),
                spring=cl.FoundationSpring(k),
                tilt=cl.Tilt((0.45, 1.0)),
            )
        ],
        space=space,
    )
    found = problem.solve()
    entry = found.summary["contacts"][0]
    assert entry["tilt"]["angle"] == pytest.approx(turned(study)["angle"], rel=1e-5)
    assert entry["tool"]["travel"] == pytest.approx(told(study)["travel"], rel=1e-5)
    k.value = 4.0
    stiffer = problem.solve().summary["contacts"][0]["tool"]["travel"]
    assert 0.0 < stiffer < entry["tool"]["travel"]
    problem.close()


@pytest.mark.parametrize("limit", [math.inf, 0.012])
def test_a_plate_with_much_friction_is_one_that_is_glued_to_the_body(limit: float) -> None:
    """The force that a glued plate takes moves a pressed plate as far, while nothing lifts off."""
    mesh = {"builder": "block", "h": 0.25, "structured": True, "cells": "box"}
    material = {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": limit}
    given: dict[str, Any] = {"mesh": mesh, "material": material}
    moved = [*HELD, {"on": "top", "value": [0.0, -0.01]}]
    glued = solved(pressed([], loads={"displacements": moved}, **given))
    force = glued.summary["reactions"]["top"][1]
    # By symmetry it does not turn, whether it may or not.
    tilts: list[dict[str, Any]] = [{}, {"tilt": {"about": [0.5, 1.0]}}]
    for tilt in tilts:
        plate = held(mu=1e3, force=[0.0, force], **tilt)
        found = solved(pressed(plate, loads={"displacements": HELD}, **given))
        u, w = glued.displacement.x.array, found.displacement.x.array
        assert np.abs(u - w).max() <= 1e-5 * np.abs(u).max()
        assert told(found)["travel"] == pytest.approx(0.01, rel=1e-5)


# What is refused.


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tilt": {"about": [1.4, 1.0]}}, "on both sides"),
        ({"tilt": {"about": [0.5]}}, "must have 2 components"),
        ({"spring": {"stiffness": 2.0, "along": [1.0, 0.0]}}, "along the surface"),
        ({"spring": {"stiffness": 2.0}}, "direction in which the spring gives way"),
        ({"spring": {"stiffness": 0.0, "along": [0.0, 1.0]}}, "stiffness"),
        (
            {"force": [0.0, -1.0], "spring": {"stiffness": 2.0, "along": [0.0, 1.0]}},
            "acts along force",
        ),
        (
            {"tilt": {"about": [0.5, 2.0]}, "half_space": None}
            | {"sphere": {"centre": [0.5, 2.0], "radius": 1.0}},
            "another point",
        ),
    ],
)
def test_a_foundation_that_nothing_would_stop_is_refused(
    changes: dict[str, Any], words: str
) -> None:
    with pytest.raises((InputError, ValueError), match=words):
        solve(pressed(held(**changes)))
