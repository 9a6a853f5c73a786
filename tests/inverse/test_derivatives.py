"""Derivatives of a solution against central differences of solves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest
from differences import errors
from differentiated_block import NAMES, Block, block, quantities
from slow import slow

import contact_locking as cl
from contact_locking.inverse.derivatives import entries, number_of

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


def test_a_moving_friction_bound_takes_fewer_solves_than_the_solution_took(make: Make) -> None:
    made = make()
    solution = made.problem.solve()
    lazy: Any = solution.differentiable
    lazy.made.adjoint("compliance")
    adjoint = lazy.made.linear.solves
    lazy.made.forward(NAMES, entries(made.given["E"]))
    assert 0 < adjoint <= 0.5 * solution.summary["iterations"]["linear"]
    assert lazy.made.linear.solves - adjoint <= 0.5 * solution.summary["iterations"]["linear"]


@pytest.mark.serial
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
