"""A law of the user's own: an energy in UFL beside those of the package."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from problems import block

import contact_locking as cl
from contact_locking import StudySolution, solve
from contact_locking.errors import InputError
from contact_locking.laws.body import locking_energy, squared_norm, strain
from contact_locking.problem.strain_sets import NormSet
from contact_locking.running.assembly import StudyProblem, assemble
from contact_locking.running.solving import solve_assembled

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
    return (
        locking_energy(strain(u), one_over, fem.Constant(problem.domain.mesh, problem.penalty.n))
        * problem.data.dx
    )


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


def test_an_own_law_that_is_not_convex_does_not_converge(comm: MPI.Intracomm) -> None:
    def not_convex(problem: StudyProblem, u: fem.Function) -> Any:
        return -1e3 * squared_norm(strain(u)) * problem.data.dx

    assert not with_energy(comm, not_convex).converged


def test_an_own_law_is_not_for_the_method_of_the_paper(comm: MPI.Intracomm) -> None:
    with pytest.raises(InputError) as caught:
        with_energy(comm, ball, solver__method="penalty")
    assert caught.value.key == "energy"


def gent(u: fem.Function) -> ufl.Form:
    """``-(E M^2/2) ln(1 - |eps|^2/M^2)``, after Gent, whose stress is E eps/(1 - |eps|^2/M^2)."""
    share = squared_norm(strain(u)) / LIMIT**2
    return -0.5 * LIMIT**2 * ufl.ln(1.0 - share) * ufl.dx(degree=2)


def rajagopal(u: fem.Function) -> ufl.Form:
    """``sigma = E eps/sqrt(1 - |eps|^2/M^2)`` in all: strains stay below M under every stress."""
    share = squared_norm(strain(u)) / LIMIT**2
    return LIMIT**2 * (1.0 - ufl.sqrt(1.0 - share) - 0.5 * share) * ufl.dx(degree=2)


@pytest.mark.parametrize(
    ("energy", "stress"),
    [
        (gent, lambda e: e + e / (1.0 - (e / LIMIT) ** 2)),
        (rajagopal, lambda e: e / math.sqrt(1.0 - (e / LIMIT) ** 2)),
    ],
)
@pytest.mark.parametrize(("share", "limit"), [(0.5, math.inf), (0.99, math.inf), (0.99, 0.7)])
def test_a_column_of_an_own_law_on_exact_contact_has_its_closed_form(
    energy: Any, stress: Any, share: float, limit: float, comm: MPI.Intracomm
) -> None:
    """The strain e under the pressure ``stress(e)``, or a strain limit that is exact beside it."""
    body = mesh.create_unit_square(comm, 4, 4)
    space = fem.functionspace(body, ("Lagrange", 1, (2,)))
    bottom, left, top = (
        mesh.locate_entities_boundary(body, 1, lambda x, i=i, at=at: np.isclose(x[i], at))
        for i, at in ((1, 0.0), (0, 0.0), (1, 1.0))
    )
    tags = mesh.meshtags(body, 1, np.sort(top), np.full(len(top), 1, dtype=np.int32))
    ds = ufl.Measure("ds", body, subdomain_data=tags)(1)
    pressure = stress(share * LIMIT)
    held = fem.locate_dofs_topological(space.sub(0), 1, left)
    problem = cl.ContactProblem(
        cl.Elasticity(young=1.0, poisson=0.0),
        -pressure * ufl.TestFunction(space)[1] * ds,
        [fem.dirichletbc(0.0, held, space.sub(0))],
        [cl.StrainBall(limit * LIMIT)] if limit < 1.0 else [],
        [cl.Contact(bottom, friction=cl.Coulomb(0.3, cl.Convolution(0.5)))],
        energy=energy,
    )
    solution = problem.solve()
    assert solution.converged, solution.summary["reason"]
    strain_of_column = min(share, limit) * LIMIT
    assert solution.summary["strain_norm_max"] == pytest.approx(strain_of_column, rel=1e-7)
    assert solution.summary["contact_force"][1] == pytest.approx(pressure, rel=1e-7)
    assert solution.summary["iterations"]["tangents"] <= 40
    problem.close()


SHEAR = 0.01


def with_shape_limited(n: float, comm: MPI.Intracomm) -> StudyProblem:
    """``|eps - tr(eps)/2 I| <= LIMIT`` in the plane, beside the limit of the strain itself."""
    parameters = block(2, 0.2, material__locking_limit=0.015, penalty__n=n)
    problem = assemble(parameters, comm)
    inverse = fem.Function(problem.data.inverse_limit.function_space)
    inverse.x.array[:] = 1.0 / SHEAR
    shape = NormSet("shape", inverse, ufl.dev, ufl.dev, least=0.0)
    problem.data = dataclasses.replace(problem.data, limits=(shape,))
    return problem


def largest_change_of_shape(solution: StudySolution) -> float:
    (entry,) = solution.summary["strain_sets"]
    assert entry["name"] == "shape"
    return SHEAR * float(entry["utilisation_max"])


def test_an_own_set_of_strains_is_kept_by_the_inequality(comm: MPI.Intracomm) -> None:
    solution = solve_assembled(with_shape_limited(np.inf, comm))
    assert solution.converged, solution.summary["reason"]
    assert largest_change_of_shape(solution) == pytest.approx(SHEAR, rel=1e-6)
    assert solution.summary["strain_norm_max"] <= 0.015 * (1.0 + 1e-6)
