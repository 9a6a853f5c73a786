"""A law of the user's own: an energy in UFL beside those of the package."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI
from problems import block

from contact_locking import StudySolution, solve
from contact_locking.errors import InputError
from contact_locking.laws.convex import squared_norm
from contact_locking.laws.elasticity import strain
from contact_locking.laws.locking import locking_energy
from contact_locking.running.solving import solve_assembled
from contact_locking.study.assembly import StudyProblem, assemble

pytestmark = pytest.mark.serial

LIMIT = 0.02


def with_energy(comm: MPI.Intracomm, energy: Any, **changes: Any) -> StudySolution:
    """Solved with ``energy(problem, u)`` added."""
    problem = assemble(block(2, 0.2, **changes), comm)

    def own(u: fem.Function) -> Any:
        return energy(problem, u)

    problem.data = dataclasses.replace(problem.data, own_energy=own)
    return solve_assembled(problem)


def ball(problem: StudyProblem, u: fem.Function) -> Any:
    """The locking law of the package once more."""
    one_over = fem.Constant(problem.domain.mesh, 1.0 / LIMIT)
    return locking_energy(strain(u), one_over, problem.data.n) * problem.data.dx


def test_the_ball_as_an_own_law_gives_what_the_package_has(comm: MPI.Intracomm) -> None:
    built_in = solve(block(2, 0.2, material__locking_limit=LIMIT), comm)
    own = with_energy(comm, ball, material__locking_limit=float("inf"))
    assert built_in.converged and own.converged, own.summary["reason"]
    assert built_in.summary["locked_fraction"] > 0.05
    for key in ("compliance", "elastic_energy", "strain_norm_max", "contact_area"):
        assert own.summary[key] == pytest.approx(built_in.summary[key], rel=1e-6), key
    difference = own.displacement.x.array - built_in.displacement.x.array
    assert np.abs(difference).max(initial=0.0) < 1e-8


def test_springs_that_hold_the_body_are_in_its_balance(comm: MPI.Intracomm) -> None:
    def springs(problem: StudyProblem, u: fem.Function) -> Any:
        return 0.5 * 0.1 * squared_norm(u) * problem.domain.ds(("right",))

    solution = with_energy(comm, springs)
    assert solution.converged, solution.summary["reason"]
    total = np.sum(list(solution.summary["certificate"]["resultants"].values()), axis=0)
    u = solution.displacement
    measure = solution.domain.ds(("right",))
    pulled = [comm.allreduce(fem.assemble_scalar(fem.form(0.1 * u[i] * measure))) for i in (0, 1)]
    assert np.abs(pulled).max() > 1e-4
    assert total == pytest.approx(pulled, abs=1e-9)


def test_no_bound_is_claimed_for_an_own_law(comm: MPI.Intracomm) -> None:
    summary = with_energy(comm, ball).summary
    assert {entry["holds"] for entry in summary["bounds"].values()} == {None}
    assert all("user's own" in entry["reason"] for entry in summary["bounds"].values())
    assert "user's own" in summary["certificate"]["errors"]["penalty"]["reason"]


def test_an_own_law_that_is_not_solved_for_does_not_converge(comm: MPI.Intracomm) -> None:
    def not_convex(problem: StudyProblem, u: fem.Function) -> Any:
        return -1e3 * squared_norm(strain(u)) * problem.data.dx

    solution = with_energy(comm, not_convex)
    assert not solution.converged
    assert "positive definite" in solution.summary["reason"]
    assert "Check that the energy is convex" in solution.summary["suggestion"]


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"solver__method": "interior_point"}, "solver.method"),
        ({"penalty__n": np.inf}, "penalty.n"),
    ],
)
def test_an_own_law_takes_newtons_method(
    changes: dict[str, Any], key: str, comm: MPI.Intracomm
) -> None:
    with pytest.raises(InputError, match="user's own") as caught:
        with_energy(comm, ball, **changes)
    assert caught.value.key == key
