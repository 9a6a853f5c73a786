"""Derivatives of a solution against central differences of solves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest
import ufl
from differences import errors
from differentiated_block import NAMES, Block, block, quantities
from dolfinx import fem, mesh
from mpi4py import MPI
from petsc4py import PETSc
from slow import slow

import contact_locking as cl
from contact_locking.process import problem_solver
from contact_locking.sensitivity.parameters import Entry, Nodal
from contact_locking.solver.linear.options import PREFIX

CASES: dict[str, dict[str, Any]] = {
    "inequality": {},
    "penalty": {"n": 1e3},
    "newton": {"n": 1e3, "method": "newton"},
    "quadratic": {"degree": 2, "cells": 4},
    "local": {"kernel": cl.Local()},
    "filter": {"kernel": cl.Helmholtz(0.3)},
    "without friction": {"coefficient": lambda mu: 0.0},
    "three dimensions": {"dim": 3, "cells": 3, "kernel": cl.Local()},
}
QUICK = ("inequality",)


Make = Callable[..., Block]


@pytest.fixture
def make() -> Iterator[Make]:
    """Blocks that are closed after the test."""
    made: list[Block] = []

    def new(**given: Any) -> Block:
        made.append(block(**given))
        return made[-1]

    yield new
    for one in made:
        one.problem.close()


@pytest.mark.parametrize("case", [name if name in QUICK else slow(name) for name in CASES])
def test_derivatives_are_those_of_central_differences(case: str, make: Make) -> None:
    made = make(**CASES[case])
    solution = made.problem.solve()
    assert solution.converged
    found = {
        name: np.array([solution.derivative(quantity, given) for quantity in NAMES])
        for name, given in made.given.items()
    }
    counted = total = 0
    for name, given in made.given.items():
        at = float(given.value)
        wrong, told = errors(found[name], partial(made.at, name), at)
        wrong = wrong[np.isfinite(wrong) & told]
        counted, total = counted + len(wrong), total + len(NAMES)
        assert np.all(wrong <= 1e-3), (name, wrong)
    # Most differences of two widths agree, so that they tell something.
    assert counted >= 0.6 * total


def test_an_iterative_solve_has_the_derivatives_of_a_direct_one(make: Make) -> None:
    """Its iterate ends far from the central path, to which Newton steps bring it."""
    made, direct = make(linear="iterative", tolerance=1e-8, friction_tolerance=1e-8), make()
    solution, other = made.problem.solve(), direct.problem.solve()
    for name in ("M", "pull", "press", "mu"):
        found = [solution.derivative(quantity, made.given[name]) for quantity in NAMES]
        wanted = [other.derivative(quantity, direct.given[name]) for quantity in NAMES]
        np.testing.assert_allclose(found, wanted, rtol=1e-3)


def test_forward_and_adjoint_agree(make: Make) -> None:
    made = make(n=1e3, method="newton")
    solution = made.problem.solve()
    lazy: Any = solution.differentiable
    entries = [made.given["mu"], *(Entry(made.given[name], 0, name) for name in ("E", "M", "pull"))]
    forward = lazy.made.table(NAMES, entries)
    adjoint = [lazy.made.table([name], entries).derivatives[0] for name in NAMES]
    np.testing.assert_allclose(adjoint, forward.derivatives, rtol=1e-6)
    np.testing.assert_allclose(forward.values, quantities(solution), rtol=1e-5)


def test_few_solves_serve_many_parameters(make: Make) -> None:
    made = make(coefficient=lambda mu: 0.0)
    solution = made.problem.solve()
    for given in made.given.values():
        solution.derivative("compliance", given)
    lazy: Any = solution.differentiable
    # One quantity has one adjoint, whatever the number of parameters, and its solve is refined.
    assert lazy.made.solves <= 5
    before = lazy.made.solves
    lazy.made.forward(NAMES, [Entry(made.given["E"], 0, "E")])
    # One parameter has one solve, whatever the number of quantities.
    assert lazy.made.solves - before <= 5


def test_a_derivative_is_refused_with_its_reason(make: Make) -> None:
    made = make()
    solution = made.problem.solve()
    with pytest.raises(cl.InputError, match="count of points"):
        solution.derivative("locked_fraction", made.given["E"])
    with pytest.raises(cl.InputError, match=r"no quantity 'complience'.*compliance"):
        solution.derivative("complience", made.given["E"])
    with pytest.raises(cl.InputError, match="not by float"):
        solution.derivative("compliance", 1.0)
    fresh = made.problem.solve()
    made.given["E"].value = 2.0
    with pytest.raises(cl.InputError, match="changed since the solve"):
        fresh.derivative("compliance", made.given["E"])
    made.given["E"].value = 1.0
    step = made.problem.solve(after=fresh)
    with pytest.raises(cl.InputError, match="a step after another one"):
        step.derivative("compliance", made.given["E"])
    made.problem.solve()
    with pytest.raises(cl.InputError, match="solved again"):
        solution.derivative("compliance", made.given["E"])


def test_a_refusal_has_the_names_of_a_script(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(problem_solver, "_linear", lambda problem, linear: "iterative")
    made = make(linear="iterative", tolerance=1e-6, friction_tolerance=1e-6)
    solution = made.problem.solve()
    with pytest.raises(cl.InputError, match="factorisation") as raised:
        solution.derivative("compliance", made.given["E"])
    assert raised.value.key == "settings.linear"


def fields_of_a_block() -> tuple[cl.ContactProblem, dict[str, fem.Function]]:
    """A block whose modulus, limit and traction are functions, pressed onto its foundation."""
    body = mesh.create_unit_square(MPI.COMM_WORLD, 4, 4)
    space = fem.functionspace(body, ("Lagrange", 1, (2,)))
    left = mesh.locate_entities_boundary(body, 1, lambda x: np.isclose(x[0], 0.0))
    bottom = mesh.locate_entities_boundary(body, 1, lambda x: np.isclose(x[1], 0.0))
    clamp = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(space, 1, left), space)
    given = {
        "E": fem.Function(fem.functionspace(body, ("DG", 0))),
        "M": fem.Function(fem.functionspace(body, ("Lagrange", 1))),
        "load": fem.Function(space),
    }
    given["E"].interpolate(lambda x: 1.0 + 0.3 * x[0])
    given["M"].interpolate(lambda x: 0.03 + 0.01 * x[1])
    given["load"].interpolate(lambda x: (0.02 + 0.0 * x[0], -0.05 - 0.02 * x[0]))
    problem = cl.ContactProblem(
        cl.Elasticity(young=given["E"], poisson=0.3),
        ufl.inner(given["load"], ufl.TestFunction(space)) * ufl.dx,
        [clamp],
        [cl.StrainBall(given["M"])],
        [cl.Contact(bottom, cl.Gap(0.002), cl.Coulomb(0.3, cl.Convolution(0.4)))],
        space=space,
        n=math.inf,
        settings=cl.Settings(tolerance=1e-10, friction_tolerance=1e-11),
    )
    return problem, given


@pytest.mark.parametrize("name", ["E", slow("M"), slow("load")])
def test_a_function_has_a_field_of_derivatives(name: str) -> None:
    """Its sum with a random direction is the difference of two solves along the direction."""
    problem, fields = fields_of_a_block()
    given, random = fields[name], np.random.default_rng(3)
    solution = problem.solve()
    quantities = ("compliance", "elastic_energy", "contact_force.1", "reactions.bcs.0.1")
    found = [solution.derivative(quantity, given) for quantity in quantities]
    lazy: Any = solution.differentiable
    # A quantity has one adjoint, with friction and refinements.
    solves = lazy.made.solves
    lazy.made.by("compliance", Nodal(given, 0, 1.0))
    assert lazy.made.solves == solves
    comm, before = problem.domain.comm, given.x.array.copy()
    direction = fem.Function(given.function_space)
    size = given.x.index_map.size_global * given.x.block_size
    drawn = random.uniform(0.5, 1.5, size) * float(np.mean(comm.allgather(np.mean(before))))
    first, end = (given.x.block_size * bound for bound in given.x.index_map.local_range)
    direction.x.array[: end - first] = drawn[first:end]
    direction.x.scatter_forward()
    owned = slice(0, end - first)
    along = [
        comm.allreduce(float(field.x.array[owned] @ direction.x.array[owned])) for field in found
    ]
    sides = []
    for share in (1e-3, -1e-3):
        given.x.array[:] = before + share * direction.x.array
        summary = problem.solve().summary
        values = (summary["compliance"], summary["elastic_energy"], summary["contact_force"][1])
        sides.append(np.array([*values, summary["reactions"]["bcs.0"][1]]))
    assert sides[0][2] > 0.01
    assert all(field.function_space == given.function_space for field in found)
    np.testing.assert_allclose(along, (sides[0] - sides[1]) / 2e-3, rtol=1e-3, atol=1e-6)
    problem.close()


def test_deriving_leaves_the_problem_as_it_was(make: Make) -> None:
    made = make()
    solution = made.problem.solve()
    before = made.problem.displacement.x.array.copy()
    solution.derivative("compliance", made.given["gap"])
    assert np.array_equal(before, made.problem.displacement.x.array)
    assert made.given["gap"].value == 0.002
    again = made.problem.solve()
    # On several ranks sums are rounded in another order.
    values, wanted = again.displacement.x.array, solution.displacement.x.array
    np.testing.assert_allclose(values, wanted, rtol=0.0, atol=1e-12)


def test_a_solution_with_derivatives_lends_its_solver_to_no_other(make: Make) -> None:
    made = make(cells=4)
    solution = made.problem.solve()
    assert solution.derivative("compliance", made.given["E"]) < 0.0
    assert not [name for name in PETSc.Options().getAll() if name.startswith(PREFIX)]


def test_an_elastic_body_has_derivatives(make: Make) -> None:
    made = make()
    made.given["pull"].value, made.given["press"].value = -0.002, -0.005
    solution = made.problem.solve()
    compliance = solution.summary["compliance"]
    assert solution.summary["contact_force"][1] == pytest.approx(0.0, abs=1e-12)
    assert solution.derivative("compliance", made.given["E"]) == pytest.approx(-compliance)
    assert solution.derivative("compliance", made.given["M"]) == 0.0
    assert math.isfinite(solution.derivative("reactions.bcs.0.1", made.given["press"]))
