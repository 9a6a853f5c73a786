"""Lemmas 4.5 and 4.6: the problem (31) with a given friction traction h in place of a law."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import ufl
from convergence import norms
from dolfinx import fem
from mpi4py import MPI
from problems import block

from contact_locking import StudySolution
from contact_locking.arrays import FloatArray
from contact_locking.contact.coulomb import FrictionBound
from contact_locking.fem.compiled import integral
from contact_locking.laws.body import squared_norm
from contact_locking.mesh.domain import Domain
from contact_locking.problem.discrete_problem import distance
from contact_locking.running.assembly import assemble
from contact_locking.running.solving import solve_assembled

Wave = Callable[[FloatArray], FloatArray]


def traction(domain: Domain, h: Wave) -> fem.Function:
    """h as a field, quadratic in each cell."""
    field = fem.Function(fem.functionspace(domain.mesh, ("P", 2)))
    field.interpolate(lambda x: h(x[0]))
    return field


def solved(h: Wave, **changes: Any) -> StudySolution:
    """u_n^h of (31): ``a(u, v) + (R_n, eps(v)) + (1/eps) int [u_nu]^+ v_nu = (f, v) - int h v_x``.

    ``h`` maps the place x to the component of h along Gamma_C, the bottom of the block.
    """
    given = {"friction__coefficient": 0.0, "certificate__constants": True}
    problem = assemble(block(**{**given, **changes}), MPI.COMM_WORLD)
    bottom = problem.domain.ds(("bottom",), quadrature_degree=3)
    acting = ufl.as_vector([-traction(problem.domain, h), 0.0])
    loads = ufl.inner(acting, ufl.TestFunction(problem.u.function_space)) * bottom
    if problem.data.loads is not None:
        loads += problem.data.loads
    problem.data = dataclasses.replace(problem.data, loads=loads)
    solution = solve_assembled(problem)
    assert solution.converged, solution.summary["reason"]
    return solution


def between(one: StudySolution, other: StudySolution) -> float:
    """``|u_1 - u_2|_V`` on one mesh."""
    difference = fem.Function(one.displacement.function_space)
    difference.x.array[:] = one.displacement.x.array - other.displacement.x.array
    return norms(difference, one.domain).v


def size(solution: StudySolution, h: Wave) -> float:
    """``|h|`` in L2(Gamma_C)."""
    bottom = solution.domain.ds(("bottom",), quadrature_degree=4)
    square = squared_norm(traction(solution.domain, h)) * bottom
    return math.sqrt(integral(solution.domain, square))


@pytest.mark.serial
@pytest.mark.parametrize("n", [1e2, 1e4])
def test_lemma_4_5_i_two_methods_from_two_starts_find_one_solution(n: float) -> None:
    def h(x: FloatArray) -> FloatArray:
        return 0.01 * np.cos(3.0 * x)

    one = solved(h, penalty__n=n, solver__method="interior_point")
    other = solved(h, penalty__n=n, solver__method="penalty")
    assert between(one, other) <= 1e-6 * norms(one.displacement, one.domain).v


def cosines(coefficients: FloatArray) -> Wave:
    waves = np.pi * np.arange(len(coefficients))
    return lambda x: np.asarray(np.cos(np.multiply.outer(x, waves)) @ coefficients)


@pytest.mark.slow
@pytest.mark.serial
def test_lemma_4_5_ii_the_solution_is_lipschitz_in_h_with_c_0_over_alpha() -> None:
    random = np.random.default_rng(45)
    shares = []
    for scale in (0.1, 0.01, 0.001):
        a, b = scale * random.standard_normal((2, 4))
        first, second = solved(cosines(a)), solved(cosines(b))
        constants = first.summary["certificate"]["constants"]
        most = constants["c_0"] / constants["alpha"] * size(first, cosines(a - b))
        assert between(first, second) <= most
        shares.append(between(first, second) / most)
    # The constant is no wild overestimate.
    assert max(shares) > 0.1


def test_lemma_4_5_iii_the_norm_of_the_solution_is_bounded_by_that_of_f_h() -> None:
    found = solved(lambda x: 0.02 * np.sin(np.pi * x), material__locking_limit=math.inf)
    bound = found.summary["bounds"]["displacement_norm"]
    assert bound["holds"] is True and bound["value"] > 0.3 * bound["bound"]


@pytest.mark.slow
@pytest.mark.serial
def test_lemma_4_6_solutions_converge_where_h_oscillates_and_only_converges_weakly() -> None:
    fine = {"mesh__h": 1.0 / 32, "mesh__structured": True}
    limit = solved(np.zeros_like, **fine)
    size_of_u = norms(limit.displacement, limit.domain).v
    waves, distances, sizes = (1, 2, 4, 8), [], []
    for k in waves:

        def h(x: FloatArray, k: int = k) -> FloatArray:
            return 0.02 * np.sin(2.0 * k * np.pi * x)

        found = solved(h, **fine)
        distances.append(between(found, limit) / size_of_u)
        sizes.append(size(found, h))
    # h_k stays as large as it is, converges weakly to 0, and u_n^{h_k} to u_n^0.
    assert sizes == pytest.approx([sizes[0]] * len(waves), rel=1e-2)
    assert distances[0] > 0.01
    # Like the dual norm of h_k on traces of V, which is of order k^-1/2.
    rate = np.polyfit(np.log(waves), np.log(distances), 1)[0]
    assert np.all(np.diff(distances) < 0.0) and rate == pytest.approx(-0.5, abs=0.15)


class Tresca(FrictionBound):
    """A bound that depends on nothing."""

    strength = 0.005

    def evaluate(self, pressure: FloatArray, slip: FloatArray) -> FloatArray:
        return np.full(len(slip), self.strength)


def under_tresca(n: float, domain: Domain | None = None) -> StudySolution:
    problem = assemble(block(penalty__n=n), MPI.COMM_WORLD, domain)
    (contact,) = problem.contacts
    given = contact.friction
    contact.friction = Tresca(given.surface, given.smoothing, given.law)
    solution = solve_assembled(problem)
    assert solution.converged, solution.summary["reason"]
    return solution


@pytest.mark.serial
def test_with_the_bound_frozen_the_error_of_the_penalties_is_bounded_by_the_multipliers() -> None:
    # a(e, e) <= |Z|^2/4n + eps |p|^2/2 + delta int G, here with delta = eps: docs/problem.md.
    exact = under_tresca(math.inf)
    domain = exact.domain
    stress = integral(domain, squared_norm(exact.locking_stress) * ufl.dx(domain=domain.mesh))
    surface = domain.ds(("bottom",), quadrature_rule="vertex", quadrature_degree=1)
    pressure = integral(domain, exact.contact_pressure**2 * surface)
    bound = integral(domain, Tresca.strength * surface)
    assert min(stress, pressure) > 0.0
    data = assemble(exact.parameters, MPI.COMM_WORLD, domain).data
    for n in (1e2, 1e3, 1e4, 1e5):
        soft = under_tresca(n, domain)
        error = distance(soft.displacement, exact.displacement, data)["energy_norm"]
        assert error**2 <= stress / (4.0 * n) + pressure / (2.0 * n) + bound / n
