"""V13: the solution against Clarabel's of the same discrete problem at the same friction bound."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from conic import Body, ConicProblem, Contact
from problems import block, with_changes
from scipy.spatial import cKDTree

from contact_locking import problem
from contact_locking.parameters import Parameters
from contact_locking.solution import Solution

pytest.importorskip("clarabel")
pytestmark = pytest.mark.serial

FloatArray = npt.NDArray[np.float64]
Place = Callable[[FloatArray], Any]

LIMIT, REACH = 0.02, 0.4
PUSH = [0.006, -0.018]
# With Clarabel's own tolerances of 1e-8 its energies are up to 5e-8 above the least.
TIGHT = {"tol_gap_rel": 1e-10, "tol_gap_abs": 1e-12, "tol_feas": 1e-11}


def half_disc() -> Parameters:
    """Pressed onto a plane and pushed along it, by displacements of its flat top."""
    data: dict[str, Any] = {
        "mesh": {"builder": "disc", "contact_width": REACH, "h": 0.1, "h_contact": 0.04},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": LIMIT},
        "loads": {"displacements": [{"on": "top", "value": PUSH}]},
        "contact": {
            "on": "contact",
            "foundation": {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        },
        "friction": {"coefficient": 0.3, "smoothing": {"radius": 0.1}},
        "penalty": {"n": math.inf},
    }
    return with_changes(data)


def conic_problem(
    solution: Solution,
    touches: Place,
    held: Place,
    value: list[float],
    pulled: Place = lambda x: np.zeros(x.shape[:-1], dtype=bool),
    traction: Sequence[float] = (),
) -> ConicProblem:
    """The problem of a solution at its friction bound; places are those of nodes (..., d).

    The foundation is the plane through the origin, below the body.
    """
    space = solution.displacement.function_space
    dim = solution.domain.dim
    x = space.tabulate_dof_coordinates()[:, :dim]
    body = Body(x, space.dofmap.list, young=1.0, poisson=0.3)
    force = np.array(traction or [0.0] * dim)
    load = body.nodal_areas(body.facets(pulled))[:, None] * force
    areas = body.nodal_areas(body.facets(touches))
    areas[held(x)] = 0.0
    nodes = np.flatnonzero(areas)
    points = solution.contact_points
    assert points is not None
    distance, match = cKDTree(points.x).query(x[nodes])
    np.testing.assert_allclose(distance, 0.0, atol=1e-12)
    contact = Contact(nodes, areas[nodes], x[nodes, -1], points.bound[match], -np.eye(dim)[-1])
    penalty = solution.parameters.penalty
    return ConicProblem(
        body,
        LIMIT,
        load.ravel(),
        np.flatnonzero(held(x)),
        np.array(value),
        contact,
        n=penalty.n,
        epsilon=penalty.epsilon or 0.0,
    )


def block_problem(solution: Solution) -> ConicProblem:
    pull = [0.03, -0.05] if solution.domain.dim == 2 else [0.03, 0.0, -0.05]
    return conic_problem(
        solution,
        touches=lambda x: x[..., -1] < 1e-9,
        held=lambda x: x[..., 0] < 1e-9,
        value=[0.0] * len(pull),
        pulled=lambda x: x[..., -1] > 1.0 - 1e-9,
        traction=pull,
    )


def assert_the_same(solution: Solution, reference: ConicProblem) -> None:
    """Energy to 8 digits and displacement to 1e-5, where something locks, sticks and slips."""
    summary, u = solution.summary, reference.minimiser(**TIGHT)
    assert summary["converged"], summary["reason"]
    assert summary["locked_fraction"] > 0.1
    # The regularised law nears its bound slowly: nearly all of it counts as sticking.
    assert summary["contact_area"] > 1.1 * summary["slip_area"]
    assert summary["slip_area"] > 0.0 or reference.epsilon > 0.0
    ours = solution.displacement.x.array
    assert reference.energy(ours) == pytest.approx(reference.energy(u), rel=1e-8)
    assert summary["elastic_energy"] == pytest.approx(
        0.5 * u @ (reference.body.stiffness @ u), rel=1e-6
    )
    assert np.abs(ours - u).max() <= 1e-5 * np.abs(u).max()


@pytest.mark.parametrize(("dim", "h"), [(2, 0.05), (3, 0.25)])
def test_v13_block_agrees_with_the_conic_solver(dim: int, h: float) -> None:
    solution = problem.solve(block(dim, h, penalty__n=math.inf))
    assert_the_same(solution, block_problem(solution))


def test_v13_half_disc_agrees_with_the_conic_solver() -> None:
    solution = problem.solve(half_disc())
    reference = conic_problem(
        solution,
        touches=lambda x: (np.abs(x[..., 0]) < REACH + 1e-9) & (x[..., 1] < 0.5),
        held=lambda x: x[..., 1] > 1.0 - 1e-9,
        value=PUSH,
    )
    assert_the_same(solution, reference)


@pytest.mark.parametrize("method", ["interior_point", "newton"])
def test_v13_penalised_block_agrees_with_the_conic_solver(method: str) -> None:
    penalty = {"n": 1e4, "epsilon": 1e-4}
    solution = problem.solve(block(penalty=penalty, solver={"method": method}))
    assert_the_same(solution, block_problem(solution))
