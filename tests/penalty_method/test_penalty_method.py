"""The method of the paper: its equations, its steps, and the solutions of the general solver."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import block

from contact_locking import solve
from contact_locking.errors import InputError, NotConverged
from contact_locking.fem.compiled import assembled, integral
from contact_locking.laws.limits import Penalty
from contact_locking.penalty_method.equations import Equations
from contact_locking.penalty_method.method import PenaltyPath, contraction_factor, follow
from contact_locking.penalty_method.newton import critical_point
from contact_locking.running.assembly import assemble, check
from contact_locking.running.solving import SolvableStudy
from contact_locking.solver.monitor import Monitor

CONVOLUTION = {"coefficient": 0.3, "smoothing": {"kernel": "convolution", "radius": 0.2}}
WEAKENING = {
    "coefficient": "0.4 - 0.3*(1 - exp(-s/0.005))",
    "smoothing": {"kernel": "helmholtz", "radius": 0.2},
}


@pytest.mark.parametrize("n", [1e2, 1e4, 1e6])
@pytest.mark.parametrize("friction", [CONVOLUTION, WEAKENING], ids=["convolution", "helmholtz"])
@pytest.mark.parametrize(("dim", "h"), [(2, 0.1), (3, 0.25)])
def test_the_general_solver_finds_the_same_displacement(
    dim: int, h: float, friction: dict[str, Any], n: float, comm: MPI.Intracomm
) -> None:
    limit = "0.02*(1 + 0.2*x)"
    data = {"penalty__n": n, "friction": friction, "material__locking_limit": limit}
    sharp = {"tolerance": 1e-9, "friction_tolerance": 1e-9}
    paper, general = (
        solve(block(dim, h, **data, solver={**sharp, "method": method}), comm)
        for method in ("penalty", "auto")
    )
    assert paper.converged and general.converged
    assert paper.summary["locked_fraction"] > 0.1 and paper.summary["contact_area"] > 0.1
    u, w = paper.displacement.x.array, general.displacement.x.array
    largest = comm.allreduce(np.abs(w).max(initial=0.0), op=MPI.MAX)
    assert np.abs(u - w).max(initial=0.0) <= 1e-8 * largest
    assert 0.0 < paper.summary["friction_fixed_point"]["contraction"] < 1.0
    stages = paper.summary["stages"]
    assert stages[-1]["n"] == n and all(10 * a["n"] > 0.99 * b["n"] for a, b in pairwise(stages))


@contextmanager
def rough(dim: int, size: float) -> Iterator[Equations]:
    """The equations at a displacement that locks, touches and slips somewhere, on any partition."""
    parameters = block(dim, 0.2 if dim == 2 else 0.5, solver__method="penalty")
    problem = assemble(parameters, MPI.COMM_WORLD)
    system = SolvableStudy(problem).solver.system
    problem.u.interpolate(
        lambda x: size * np.array([np.sin(7.0 * x[0] + 3.0 * i + 5.0 * x[1]) for i in range(dim)])
    )
    for contact in problem.contacts:
        system.bounds[contact] = 0.5 + contact.surface.points[:, 0]
    equations = Equations(system)
    equations.set_penalty(Penalty(50.0, 0.1, (0.1,)))
    equations.refresh()
    yield equations
    problem.close()


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("size", [0.01, 0.3])
def test_25_is_the_derivative_of_the_energy_and_the_tangent_that_of_25(
    dim: int, size: float
) -> None:
    with rough(dim, size) as equations:
        u = equations.system.u
        space, domain = u.function_space, equations.contacts[0].contact.surface.domain
        v, du = ufl.TestFunction(space), fem.Function(space)
        du.interpolate(lambda x: np.array([np.cos(3.0 * x[0] + 2.0 * i) for i in range(dim)]))
        start, t = u.x.array.copy(), 1e-6
        forces = assembled(equations.residual(u, v))
        slopes = assembled(equations.tangent(u, v, du))
        energies, residuals = [], []
        for sign in (1.0, -1.0):
            u.x.array[:] = start + sign * t * du.x.array
            energies.append(integral(domain, equations.energy(u)))
            residuals.append(assembled(equations.residual(u, v)))
        work = (energies[0] - energies[1]) / (2.0 * t)
        assert work == pytest.approx(forces @ du.x.array, rel=1e-6)
        difference = (residuals[0] - residuals[1]) / (2.0 * t)
        assert np.linalg.norm(difference - slopes) <= 1e-4 * np.linalg.norm(slopes)


@pytest.mark.serial
def test_the_friction_bound_is_mu_times_the_smoothed_pressure_of_the_law() -> None:
    friction = {"coefficient": "0.2 + 0.1*s", "smoothing": {"kernel": "none"}}
    problem = assemble(block(friction=friction, solver__method="penalty"), MPI.COMM_WORLD)
    equations = Equations(SolvableStudy(problem).solver.system)
    equations.set_penalty(Penalty(1e3, 1e-2, (1e-2,)))
    # A rigid motion presses by 0.02 and slips by 0.3 everywhere.  Clamped nodes carry no pressure.
    problem.u.interpolate(lambda x: np.array([0.3 + 0.0 * x[0], -0.02 + 0.0 * x[0]]))
    ((bound,), (contact,)) = equations.friction_bounds(), problem.contacts
    expected = np.where(contact.free, (0.2 + 0.1 * 0.3) * (0.02 / 1e-2), 0.0)
    assert bound == pytest.approx(expected, rel=1e-12)


@pytest.mark.serial
def test_a_step_ends_where_the_slope_has_halved() -> None:
    assert critical_point(lambda t: t - 2.0, -2.0) == 1.0
    for kink in (0.9, 0.1, 0.01):

        def slope(t: float, kink: float = kink) -> float:
            return -1.0 if t < kink else 300.0 * (t - kink) - 1.0

        t = critical_point(slope, -1.0)
        assert kink < t < 1.0 and abs(slope(t)) <= 0.5


@pytest.mark.serial
def test_a_stage_that_fails_is_halved_and_the_last_failure_says_where() -> None:
    path = PenaltyPath(Penalty(10.0, 0.1, ()), Penalty(1e4, 1e-4, ()))
    solved: list[float] = []

    def stage(penalty: Penalty, is_last: bool, most: float = 4.0, end: float = math.inf) -> None:
        if penalty.n > most * (solved[-1] if solved else 10.0) or penalty.n > end:
            raise NotConverged("no")
        solved.append(penalty.n)

    follow(path, stage)
    assert solved[0] == pytest.approx(10.0) and solved[-1] == 1e4
    solved.clear()
    with pytest.raises(NotConverged, match=r"n = 1.*epsilon = "):
        follow(path, lambda penalty, is_last: stage(penalty, is_last, math.inf, 120.0))
    assert solved[-1] <= 120.0


@pytest.mark.serial
def test_the_contraction_factor_is_the_mean_ratio_of_changes_without_the_first() -> None:
    assert contraction_factor([9.0, 1.0, 0.5, 0.25, 0.125], 1e-8) == pytest.approx(0.5)
    assert contraction_factor([1.0, 1e-12], 1e-8) is None


@pytest.mark.serial
@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"penalty__n": math.inf}, "penalty.n"),
        ({"discretisation__degree": 2}, "discretisation.degree"),
        ({"friction__regularisation": 0.0}, "friction.regularisation"),
        ({"loads__displacements": [{"on": "left", "value": [0, None]}]}, "loads.displacements"),
    ],
)
def test_what_the_paper_does_not_have_is_refused_by_its_key(
    changes: dict[str, Any], key: str
) -> None:
    for method in ("penalty", "newton"):
        parameters = block(**changes, solver__method=method)
        for refused in (solve, lambda given: check(given, MPI.COMM_WORLD)):
            with pytest.raises(InputError) as caught:
                refused(parameters)
            assert caught.value.key == key


@pytest.mark.serial
@pytest.mark.parametrize("limit", ["max_friction_updates", "max_iterations"])
def test_a_solve_that_may_not_settle_does_not_converge(limit: str) -> None:
    found = solve(block(solver={"method": "penalty", limit: 2}))
    assert not found.converged and np.isfinite(found.summary["compliance"])


@pytest.mark.serial
def test_an_interrupt_in_a_callback_is_no_failed_solve() -> None:
    class Interrupting(Monitor):
        def iteration(self, k: int, residual: float) -> None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solve(block(h=0.25, solver__method="penalty"), monitor=Interrupting())
