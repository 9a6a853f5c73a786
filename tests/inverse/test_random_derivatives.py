"""Derivatives of random problems against central differences of solves."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from differences import errors
from differentiated_block import NAMES, Block, block

import contact_locking as cl
from contact_locking.inverse.lazy import LazyDerivatives

# So many problems, each with one random number.
PROBLEMS = 20
# Where no more than this share of any kind of points is near a change, derivatives are unmarked.
MARKED = 0.0


def drawn(random: np.random.Generator) -> tuple[Block, str]:
    """A block with random data, and the name of one number in its data."""
    kernel = [cl.Local(), cl.Convolution(0.4), cl.Helmholtz(0.3)][random.integers(3)]
    degree = int(random.integers(1, 3))
    n = [math.inf, 1e3][random.integers(2)]
    made = block(n=n, degree=degree, cells=8 // degree, kernel=kernel)
    for given in made.given.values():
        given.value = float(given.value) * random.uniform(0.7, 1.4)
    return made, list(made.given)[random.integers(len(made.given))]


def shares_of(solution: cl.Solution) -> dict[str, float]:
    """The shares of points near a change of their state; collective."""
    derivatives = solution.differentiable
    assert isinstance(derivatives, LazyDerivatives)
    return derivatives.made.share_at_change()


@pytest.mark.slow
def test_random_problems_have_the_derivatives_of_differences() -> None:
    random = np.random.default_rng(7)
    found: list[tuple[float, bool]] = []
    for _ in range(PROBLEMS):
        made, name = drawn(random)
        solution = made.problem.solve()
        given = made.given[name]
        derivatives = np.array([solution.derivative(quantity, given) for quantity in NAMES])
        shares = shares_of(solution)
        at = float(given.value)
        wrong, told = errors(derivatives, partial(made.at, name), at)
        is_marked = max(shares.values()) > MARKED
        found += [(float(error), is_marked) for error in wrong[told & np.isfinite(wrong)]]
        made.problem.close()
    close = [error <= 1e-3 for error, _ in found]
    assert len(found) > 3 * PROBLEMS
    assert np.mean(close) >= 0.95
    assert max(error for error, is_marked in found if not is_marked) <= 1e-2
