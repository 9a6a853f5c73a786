"""Rigid motions that the data do not make, and pressures that are small but not rounding."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from slow import slow

from contact_locking.arrays import FloatArray
from contact_locking.monitor import Monitor
from contact_locking.process import solving
from contact_locking.process.of_study import solver_of
from contact_locking.results.solution import StudySolution
from contact_locking.study.assembly import assemble
from contact_locking.study_file.parameters import Parameters


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
    data = _LET_GO | {
        "steps": {"times": [0.5, 1.0], "least": 0.25},
        "solver": {"linear": linear},
    }
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


def _anchored(data: dict[str, Any], u: Any) -> tuple[FloatArray, FloatArray]:
    """A displacement (d, k) of points (3, k), and what the system keeps of it."""
    problem = assemble(Parameters.model_validate(data), MPI.COMM_WORLD)
    system = solver_of(problem, Monitor()).system
    problem.u.interpolate(u)
    problem.constraints.apply(problem.u)
    return problem.u.x.array.copy(), system.rounding.anchored


def test_only_the_motion_that_nothing_asks_for_is_taken_away() -> None:
    def slides(x: FloatArray) -> FloatArray:
        return np.array([1e6 + 1e-3 * x[0] ** 2, -0.1 + 0.0 * x[0]])

    _, free = _anchored(_block(_pulled(0.0, 1.0, 1.0), gap=0.1), slides)
    # The way to the foundation and the strain are left, of the slide no more than their sizes.
    assert 1e-3 < np.abs(free).max() < 1.0
    loads = _pulled(0.0, 1.0, 1.0) | {"displacements": [{"on": "top", "value": [1e6, None]}]}
    whole, guided = _anchored(_block(loads, gap=0.1), slides)
    np.testing.assert_allclose(guided, whole, rtol=1e-9, atol=1e-9)


def test_a_fall_through_a_gap_that_closes_is_kept() -> None:
    def falls(x: FloatArray) -> FloatArray:
        return np.array([0.0 * x[0], -0.1 + 0.0 * x[0]])

    loads = _pulled(0.0, 1.0, 1.0)
    whole, kept = _anchored(_block(loads, gap=0.1), falls)
    np.testing.assert_allclose(kept, whole, atol=1e-14)
    # No foundation is there to stop a fall of a hundred times the gap.
    _, kept = _anchored(_block(loads, gap=1e-3), falls)
    assert np.abs(kept).max() < 1e-10


def test_a_tool_that_follows_the_body_asks_for_no_displacement() -> None:
    """With the last force of the process the tool only touches the body, which runs away."""
    data = _LET_GO | {"steps": {"times": [0.5, 1.0]}}
    problem = assemble(Parameters.model_validate(data), MPI.COMM_WORLD)
    system = solver_of(problem, Monitor()).system
    (tool,) = system.tools
    problem.u.interpolate(lambda x: np.array([2e5 + 0.0 * x[0], 1e6 + 0.0 * x[0]]))
    problem.clock.set(1.0)
    tool.advance()
    assert not tool.acts
    system.tools.settle(problem.u)
    assert system.tools.travels[0] < -1e5
    assert np.abs(system.rounding.anchored).max() < 1e-6


# The prescribed displacement has a rounding of 1e-16 of itself, and its strains at the tolerance of
# the solver 1e-14, as shares of the motion.  These are gaps and meshes at which the sum of products
# for the energy has much rounding.
@pytest.mark.parametrize(("overlap", "accuracy"), [(1e-12, 0.02), slow(1e-10, 1e-3), (1e-7, 1e-6)])
@pytest.mark.parametrize(
    ("dim", "h", "gap"),
    [(2, 0.1, 0.02825654153028674), (2, 0.25, 0.00010603293610157725), (3, 0.5, 0.02349)],
)
def test_an_overlap_above_the_rounding_presses_in_proportion(
    dim: int, h: float, gap: float, overlap: float, accuracy: float
) -> None:
    """A top that goes a small share of the gap too far strains the body by as little."""
    tangents, forces = [], []
    for share in (overlap, 1e-3):
        lowered = gap * (1.0 + share)
        loads = {"displacements": [{"on": "top", "value": [0.0] * (dim - 1) + [-lowered]}]}
        found = _solution(_block(loads, gap=gap, friction=0.0, dim=dim, h=h))
        assert found.converged, found.summary["reason"]
        forces.append(found.summary["contact_force"][-1] / (lowered - gap))
        tangents.append(found.summary["iterations"]["tangents"])
    assert forces[1] > 0.0
    assert forces[0] == pytest.approx(forces[1], rel=accuracy)
    assert tangents[0] <= tangents[1] + 4
