"""V12: the penalty of contact against the mesh size, Chouly and Hild (2013)."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import sympy as sp
from manufactured import Errors, Manufactured, X, Y, rate
from slow import slow
from verification_table import Rows

SIZES = [1 / 8, 1 / 16, 1 / 32, 1 / 64]
# With eps = h the foundation would be as soft as the body; it is this much stiffer.
STIFF = 64.0
# The body touches where x < 2/3.
SIGNORINI = Manufactured(
    (sp.sin(X + 2 * Y + 0.3) / 20 + 0.3 * Y, -sp.cos(2 * X - Y) / 20),
    sp.cos(sp.pi * X) + 0.5,
    epsilon=0.0,
)


def error(h: float, epsilon: float) -> Errors:
    """The errors of a penalised solution against the exact solution of Signorini's problem."""
    penalty = {"n": 1e4, "epsilon": epsilon} if epsilon > 0.0 else {"n": math.inf}
    return SIGNORINI.errors(SIGNORINI.solved(h, penalty=penalty))


@pytest.mark.parametrize(
    ("text", "epsilon", "expected"),
    [
        slow("0", lambda h: 0.0, 1.0),
        ("h/64", lambda h: h / STIFF, 1.0),
        slow("h^2/64", lambda h: h**2 / STIFF, 1.0),
        slow("sqrt(h)/64", lambda h: math.sqrt(h) / STIFF, 0.5),
    ],
)
def test_v12_error_in_v_is_of_the_order_of_epsilon_plus_h(
    text: str, epsilon: Callable[[float], float], expected: float, found: Rows
) -> None:
    errors = [error(h, epsilon(h)) for h in SIZES]
    in_v = rate(SIZES, [e.v for e in errors])
    found.add("V12", f"Signorini, eps = {text}", "rate in V", in_v, expected, abs=0.15)


@pytest.mark.slow
@pytest.mark.serial
def test_v12_a_mesh_of_epsilon_squared_is_far_finer_than_needed(found: Rows) -> None:
    # The paper takes h = 1/n^2 = eps^2.  For eps = 1/16 that is 1/256, but already from h = 2 eps
    # to h = eps/4 nothing is gained: what is left is the penalty's.
    epsilon = 1 / 16
    coarse, fine = error(2.0 * epsilon, epsilon).v, error(epsilon / 4.0, epsilon).v
    quantity = "V error at h = 1/8 over h = 1/64"
    found.add("V12", "eps = 1/16", quantity, coarse / fine, 1.0, rel=0.2)
