"""Newton's method on the pieces of the laws: its steps, their number, and where it gives up."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from block_problems import half_space
from mpi4py import MPI

from contact_locking import Parameters, load
from contact_locking.process import solving
from contact_locking.solver.interior_point.family import dot
from contact_locking.solver.interior_point.friction_cones import FrictionCones
from contact_locking.solver.interior_point.half_lines import HalfLines
from contact_locking.solver.interior_point.locking_cones import LockingCones, StrainHalfLines
from contact_locking.solver.interior_point.lorentz import norm
from contact_locking.solver.interior_point.projections import (
    FrictionProjection,
    HalfLineProjection,
    LockingProjection,
    Projection,
    inside,
)

DEMOS = Path(__file__).resolve().parents[2] / "demos"
POINTS, STIFFEST = 6, 1e9


def _points(**given: Any) -> Any:
    """Points with weights, which is all that the algebra of a family takes."""
    return SimpleNamespace(comm=MPI.COMM_SELF, weights=np.ones(POINTS), **given)


def _half_lines(compliance: float) -> tuple[Projection[Any], Any]:
    family: HalfLines = StrainHalfLines(
        _points(limit=np.full(POINTS, 0.7), rows=1), compliance, number=0
    )
    law = HalfLineProjection(family, 2.0, STIFFEST)

    def projected(y: Any, seen: Any) -> Any:
        return np.maximum(0.0, y + law.c * (seen - 0.7)) / (1.0 + law.c * compliance)

    return law, projected


def _locking(compliance: float) -> tuple[Projection[Any], Any]:
    family = LockingCones(_points(limit=np.full(POINTS, 0.7), rows=3), compliance, 0)
    law = LockingProjection(family, 2.0, STIFFEST)

    def projected(y: Any, seen: Any) -> Any:
        v = y + law.c * seen
        excess = np.maximum(norm(v) - law.c * 0.7, 0.0) / (1.0 + law.c * compliance)
        return excess * v / norm(v)

    return law, projected


def _friction(bound: float) -> tuple[Projection[Any], Any]:
    family = FrictionCones(_points(dim=3), 0.0, 1.0)
    family.z[0] = bound
    law = FrictionProjection(family, 2.0, STIFFEST)

    def projected(y: Any, seen: Any) -> Any:
        v = y + law.c * seen
        return v * bound / np.maximum(bound, norm(v))

    return law, projected


@pytest.mark.parametrize(
    ("make", "number"),
    [(_half_lines, 1e-3), (_half_lines, 0.3), (_locking, 1e-3), (_locking, 0.3), (_friction, 1.5)],
)
def test_steps_solve_the_linearised_equation(make: Any, number: float) -> None:
    law, projected = make(number)
    random = np.random.default_rng(7)
    shape = (POINTS,) if make is _half_lines else (3, POINTS)
    y, seen, change = 2.0 * random.standard_normal((3, *shape))
    law.family.seen = seen
    law.start(y)
    law.linearise()
    law.evaluate()
    dual = law.step(change).dual
    dy = dual if make is _half_lines else -dual[1:]
    # y + dy = P(y + c s) + DP(dy + c ds), with the derivative of P by central differences.
    h = 1e-8
    ahead, behind = (projected(y + t * dy, seen + t * change) for t in (h, -h))
    wanted = projected(y, seen) + (ahead - behind) / (2.0 * h)
    np.testing.assert_allclose(y + dy, wanted, atol=2e-5 * max(1.0, float(np.abs(dy).max())))


def test_pairs_inside_their_cones_have_the_product_asked_for() -> None:
    x, z = np.array([2.0, 0.0, 0.0]), np.array([0.0, 3.0, 0.0])
    x_inside, z_inside = inside(x, z, 5.0, 1e-8)
    np.testing.assert_allclose(x_inside * z_inside, 1e-8)
    np.testing.assert_allclose(x_inside, x, atol=1e-4)
    np.testing.assert_allclose(z_inside, z, atol=1e-3)
    # A node that slides, one that sticks: |y| = G and x beside it, |y| < G and x = 0.
    x = np.array([[0.5, 0.0], [0.5, 0.0], [0.0, 0.0]])
    z = np.array([[2.0, 2.0], [-2.0, 1.0], [0.0, 0.5]])
    x_inside, z_inside = inside(x, z, 5.0, 1e-8)
    np.testing.assert_allclose(dot(x_inside, z_inside), 1e-8, rtol=1e-6)
    assert np.all(x_inside[0] > norm(x_inside[1:])) and np.all(z_inside[0] > norm(z_inside[1:]))
    np.testing.assert_allclose(x_inside, x, atol=1e-7)
    np.testing.assert_allclose(z_inside, z, atol=1e-6)


def _block(**changes: Any) -> Parameters:
    study: dict[str, Any] = {
        "mesh": {"builder": "block", "h": 0.1, "structured": True},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
        "loads": {
            "tractions": [{"on": "top", "value": [0.03, -0.05]}],
            "displacements": [{"on": "left", "value": [0.0, 0.0]}],
        },
        "contact": {"on": "bottom"},
        "friction": {"coefficient": 0.3, "smoothing": {"kernel": "none"}},
    }
    return Parameters.model_validate(study | changes)


def test_an_elastic_body_with_friction_takes_few_tangents_to_the_same_solution() -> None:
    found = solving.solve(_block())
    # Multigrid leaves the solve to the interior point method.
    other = solving.solve(_block(solver={"linear": "iterative"}))
    assert found.converged and other.converged
    # The first tangent is the elastic one.
    assert 1 < found.summary["iterations"]["tangents"] <= 9
    assert found.summary["iterations"]["tangents"] < other.summary["iterations"]["tangents"]
    u, v = found.displacement.x.array, other.displacement.x.array
    assert found.domain.comm.allreduce(float(np.sum((u - v) ** 2))) <= 1e-12 * (
        found.domain.comm.allreduce(float(np.sum(v**2)))
    )


def test_the_stiffness_of_sticking_leaves_no_rounding_in_the_forces() -> None:
    """A tilted foundation, whose tangents are rounded."""
    solution = solving.solve(Parameters.model_validate(half_space(2)))
    assert solution.summary["certificate"]["criteria"]["equilibrium"]["value"] <= 1e-12


def test_a_body_that_contact_holds_takes_few_tangents() -> None:
    solution = solving.solve(load(DEMOS / "ssnv128.yml").parameters)
    assert solution.converged
    assert solution.summary["iterations"]["tangents"] <= 12


@pytest.mark.parametrize("n", [math.inf, 1e4])
def test_nodes_that_leave_the_contact_one_by_one_take_few_tangents(n: float) -> None:
    """Hertz's cylinder."""
    disc = {"builder": "disc", "quarter": True, "radius": 1.0, "h": 0.2}
    study = Parameters.model_validate(
        {
            "mesh": disc | {"h_contact": 0.004, "contact_width": 0.15},
            "loads": {
                "tractions": [{"on": "top", "value": [0.0, -0.003]}],
                "displacements": [{"on": "symmetry", "value": [0.0, None]}],
            },
            "contact": {
                "on": "contact",
                "foundation": {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}},
            },
            "penalty": {"n": n},
        }
    )
    found = solving.solve(study)
    assert found.converged and found.summary["iterations"]["tangents"] <= 8


def test_a_body_that_locks_in_many_cells_is_left_to_the_interior_point_method() -> None:
    material = {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02}
    solution = solving.solve(_block(material=material))
    assert solution.converged and solution.summary["locked_fraction"] > 0.1


@pytest.mark.parametrize("n", [math.inf, 1e4])
def test_steps_go_on_from_the_locked_cells_of_the_last(n: float) -> None:
    material = {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02}
    tractions = [{"on": "top", "value": ["0.03*(1 + 0.1*t)", -0.05]}]
    loads = {"tractions": tractions, "displacements": [{"on": "left", "value": [0.0, 0.0]}]}
    study = _block(
        material=material,
        loads=loads,
        steps={"to": 1.0, "count": 4},
        penalty={"n": n},
        friction={"coefficient": 0.3},
    )
    steps = list(solving.solve_steps(study))
    assert all(step.converged for step in steps)
    first, *later = (step.summary["iterations"]["tangents"] for step in steps)
    assert np.mean(later) <= 8.0 and np.mean(later) < first


def test_friction_of_the_last_step_turns_with_a_foundation_that_moves_along() -> None:
    """The normal of a cylinder at a node turns, and no part of the old friction stays along it."""
    parameters = _block(
        loads={"displacements": [{"on": "bottom", "value": [0.0, 0.0]}]},
        contact={
            "on": "top",
            "foundation": {
                "cylinder": {"centre": [0.5, 2.0], "radius": 1.0},
                "motion": ["0.05*max(t - 1, 0)", "-0.02*min(t, 1)"],
            },
        },
        steps={"times": [1.0, 1.2, 1.4]},
    )
    pressed, *moved = solving.solve_steps(parameters)
    assert pressed.converged and all(step.converged for step in moved)
    tangents = [step.summary["iterations"]["tangents"] for step in moved]
    assert max(tangents) < pressed.summary["iterations"]["tangents"]


# It takes a minute on two ranks.
@pytest.mark.serial
def test_a_press_fit_that_turns_sticks_before_it_slips() -> None:
    """The torque is 2 pi b^2 mu p with the pressure p of Lamé, for a hub and a ring that are held.

    At the first tangent of the third step the tolerances are reached, and at the next they are
    not.
    """
    study = {
        "mesh": {
            "builder": "disc_in_ring",
            "radius": 10.0,
            "hole": 4.0,
            "inner_radius": 10.0,
            "outer_radius": 15.0,
            "h": 2.5,
        },
        "material": {"elasticity": {"young": 210000.0, "poisson": 0.3}, "plane": "stress"},
        "loads": {
            "displacements": [
                {"on": "outer", "value": [0.0, 0.0]},
                {"on": "hole", "value": ["-0.01*y*max(t - 1, 0)", "0.01*x*max(t - 1, 0)"]},
            ]
        },
        "contact": {
            "on": "rim",
            "against": "inner",
            "gap": "-0.004*min(t, 1)",
            # A linear rotation makes the hub larger by 3 % of the overlap.
            "pair": "once",
        },
        "friction": {"coefficient": 0.12},
        "steps": {"times": [1.0, 1.05, 1.1, 1.5]},
    }
    *stuck, slipped = solving.solve_steps(Parameters.model_validate(study))
    assert all(step.converged for step in stuck) and slipped.converged
    # u = A (r - c^2/r) in the ring of outer radius c, and in the hub with the radius a of its hole.
    ring = 12.5 * 0.91 / (1.3 + 0.7 * 2.25)
    hub = 8.4 * 0.91 / (1.3 + 0.7 * 0.16)
    pressure = 210000.0 * 0.004 / (ring + hub)
    torque = abs(slipped.summary["contact_moment"])
    assert torque == pytest.approx(2.0 * math.pi * 100.0 * 0.12 * pressure, rel=0.03)
