"""Derivatives of a solution against central differences of solves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from slow import slow

import contact_locking as cl
from contact_locking.arrays import FloatArray
from contact_locking.inverse.derivatives import entries, number_of

# The widths of two central differences, relative to the value of the parameter.
WIDTHS = (1e-4, 3e-5)
# Two differences that disagree by more than this, relative, tell nothing: a point changes its state
# between the solves.
AGREE = 1e-3
# A derivative by ``ln p`` below this share of the quantity is judged by that share: a difference of
# two solves has no more digits.
LEAST = 1e-2


def difference(values: Callable[[float], FloatArray], at: float, width: float) -> FloatArray:
    """``d values/d ln p`` by a central difference of this width."""
    return np.asarray((values(at * (1.0 + width)) - values(at * (1.0 - width))) / (2.0 * width))


def errors(
    derivatives: FloatArray, values: Callable[[float], FloatArray], at: float
) -> tuple[FloatArray, FloatArray]:
    """Errors of derivatives (m,) by p at the value ``at``, and whether differences tell them.

    The errors are relative to the derivative by ``ln p``, or to a share of the quantity.
    """
    wide, narrow = (difference(values, at, width) for width in WIDTHS)
    size = np.maximum(np.abs(narrow), LEAST * np.abs(values(at)))
    with np.errstate(all="ignore"):
        told = np.abs(wide - narrow) <= AGREE * size
        return np.abs(derivatives * at - narrow) / size, told


#: The quantities that the tests derive.
NAMES = (
    "compliance",
    "elastic_energy",
    "contact_force.1",
    "friction_force.0",
    "reactions.bcs.0.1",
    "pressure_max",
)


@dataclass
class Block:
    """A problem with the constants and numbers in its data, and their values."""

    problem: cl.ContactProblem
    given: dict[str, fem.Constant | cl.Number]

    def at(self, name: str, value: float) -> FloatArray:
        """The quantities NAMES with another value of one number; collective."""
        return self.values(**{name: value})

    def values(self, **changed: float) -> FloatArray:
        """The quantities NAMES with other numbers, by a solve; collective."""
        before = {name: float(self.given[name].value) for name in changed}
        for name, value in changed.items():
            self.given[name].value = value
        solution = self.problem.solve()
        for name, value in before.items():
            self.given[name].value = value
        assert solution.converged
        return quantities(solution)


def quantities(solution: cl.Solution) -> FloatArray:
    """The quantities NAMES of a solution; collective."""
    summary = solution.summary
    largest = max(float(np.max(item.pressure, initial=0.0)) for item in solution.contacts)
    return np.array(
        [
            summary["compliance"],
            summary["elastic_energy"],
            summary["contact_force"][1],
            summary["friction_force"][0],
            summary["reactions"]["bcs.0"][1],
            MPI.COMM_WORLD.allreduce(largest, op=MPI.MAX),
        ]
    )


def block(
    n: float = math.inf,
    degree: int = 1,
    dim: int = 2,
    cells: int = 8,
    kernel: Any = None,
    coefficient: Callable[[cl.Number], Any] | None = None,
    **settings: Any,
) -> Block:
    """A unit block, clamped on the left and pressed onto the foundation at a gap."""
    comm = MPI.COMM_WORLD
    make = mesh.create_unit_square if dim == 2 else mesh.create_unit_cube
    body = make(comm, *[cells] * dim)
    space = fem.functionspace(body, ("Lagrange", degree, (dim,)))
    left = mesh.locate_entities_boundary(body, dim - 1, lambda x: np.isclose(x[0], 0.0))
    bottom = mesh.locate_entities_boundary(body, dim - 1, lambda x: np.isclose(x[dim - 1], 0.0))
    fixed = fem.locate_dofs_topological(space, dim - 1, left)
    clamp = fem.dirichletbc(np.zeros(dim), fixed, space)
    young, limit = fem.Constant(body, 1.0), fem.Constant(body, 0.03)
    pull, press = fem.Constant(body, 0.02), fem.Constant(body, 0.05)
    mu, gap = cl.Number(0.3), cl.Number(0.002)
    v = ufl.TestFunction(space)
    loads = (pull * v[0] - press * v[dim - 1]) * ufl.dx
    law = cl.Coulomb(
        coefficient(mu) if coefficient else lambda x, s: mu.value * np.exp(-s / 0.05),
        kernel or cl.Convolution(0.3),
    )
    problem = cl.ContactProblem(
        cl.Elasticity(young=young, poisson=0.3),
        loads,
        [clamp],
        [cl.StrainBall(limit)],
        [cl.Contact(bottom, friction=law, gap=gap)],
        space=space,
        n=n,
        # Differences of solves show what the solves leave, divided by their width.
        settings=cl.Settings(**{"tolerance": 1e-10, "friction_tolerance": 1e-11} | settings),
    )
    given = {"E": young, "M": limit, "pull": pull, "press": press, "mu": mu, "gap": gap}
    return Block(problem, given)


CASES: dict[str, dict[str, Any]] = {
    "inequality": {},
    "penalty": {"n": 1e3},
    "paper": {"n": 1e3, "method": "penalty"},
    "quadratic": {"degree": 2, "cells": 4},
    "local": {"kernel": cl.Local()},
    "filter": {"kernel": cl.Helmholtz(0.3)},
    "without friction": {"coefficient": lambda mu: 0.0},
    "three dimensions": {"dim": 3, "cells": 3, "kernel": cl.Local()},
}


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


@pytest.mark.parametrize("case", [name if name == "inequality" else slow(name) for name in CASES])
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


@pytest.mark.parametrize(
    ("n", "settings"), [(math.inf, {"linear": "iterative"}), (1e7, {"method": "penalty"})]
)
def test_other_solvers_have_the_derivatives_of_a_direct_one(
    n: float, settings: dict[str, Any], make: Make
) -> None:
    """An iterate may end far from the central path, and large penalties leave little room."""
    settings |= {"tolerance": 1e-8, "friction_tolerance": 1e-8}
    made, direct = make(n=n, **settings), make(n=n)
    solution, other = made.problem.solve(), direct.problem.solve()
    for name in ("M", "pull", "press", "mu"):
        found = [solution.derivative(quantity, made.given[name]) for quantity in NAMES]
        wanted = [other.derivative(quantity, direct.given[name]) for quantity in NAMES]
        np.testing.assert_allclose(found, wanted, rtol=1e-3)


@pytest.mark.serial
def test_forward_and_adjoint_agree(make: Make) -> None:
    made = make(n=1e3, method="penalty")
    solution = made.problem.solve()
    lazy: Any = solution.differentiable
    constants = [entries(made.given[name])[0] for name in ("E", "M", "pull")]
    numbers = [number_of(made.given["mu"]), *constants]
    forward = lazy.made.table(NAMES, numbers)
    adjoint = [lazy.made.table([name], numbers).derivatives[0] for name in NAMES]
    np.testing.assert_allclose(adjoint, forward.derivatives, rtol=1e-6)
    np.testing.assert_allclose(forward.values, quantities(solution), rtol=1e-5)


@pytest.mark.serial
def test_few_solves_serve_many_parameters(make: Make) -> None:
    made = make(coefficient=lambda mu: 0.0)
    solution = made.problem.solve()
    for given in made.given.values():
        solution.derivative("compliance", given)
    lazy: Any = solution.differentiable
    # One quantity has one adjoint, whatever the number of parameters, and its solve is refined.
    assert lazy.made.linear.solves <= 5
    before = lazy.made.linear.solves
    lazy.made.forward(NAMES, entries(made.given["E"]))
    # One parameter has one solve, whatever the number of quantities.
    assert lazy.made.linear.solves - before <= 5


@pytest.mark.serial
def test_a_derivative_is_refused_with_its_reason(make: Make) -> None:
    made = make()
    solution = made.problem.solve()
    with pytest.raises(cl.InputError, match="count of points"):
        solution.derivative("locked_fraction", made.given["E"])
    with pytest.raises(cl.InputError, match=r"no quantity 'complience'.*compliance"):
        solution.derivative("complience", made.given["E"])
    with pytest.raises(cl.InputError, match="not float"):
        solution.derivative("compliance", 1.0)
    fresh = made.problem.solve()
    made.given["E"].value = 2.0
    with pytest.raises(cl.InputError, match="changed since the solve"):
        fresh.derivative("compliance", made.given["E"])
    made.given["E"].value = 1.0
    step = made.problem.solve(after=fresh)
    with pytest.raises(cl.InputError, match="steps after the first"):
        step.derivative("compliance", made.given["E"])
    made.problem.solve()
    with pytest.raises(cl.InputError, match="solved again"):
        solution.derivative("compliance", made.given["E"])


@pytest.mark.serial
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


@pytest.mark.serial
def test_an_elastic_body_has_derivatives(make: Make) -> None:
    made = make()
    made.given["pull"].value, made.given["press"].value = -0.002, -0.005
    solution = made.problem.solve()
    compliance = solution.summary["compliance"]
    assert solution.summary["contact_force"][1] == pytest.approx(0.0, abs=1e-12)
    assert solution.derivative("compliance", made.given["E"]) == pytest.approx(-compliance)
    assert solution.derivative("compliance", made.given["M"]) == 0.0
    assert math.isfinite(solution.derivative("reactions.bcs.0.1", made.given["press"]))
