"""The functions of convex analysis that the laws are made of, in UFL.

UFL can differentiate each function without a division by zero: no norm is taken of a quantity that
can vanish.
"""

from __future__ import annotations

import ufl
from ufl.core.expr import Expr


def positive_part(a: Expr) -> Expr:
    """``[a]^+ = max(a, 0)`` of a scalar, with derivative 0 at ``a = 0``."""
    return ufl.max_value(a, 0.0)


def squared_norm(a: Expr) -> Expr:
    """``|a|^2 = a : a``, the squared Euclidean (vectors) or Frobenius (tensors) norm."""
    return ufl.inner(a, a)


def unit_ball_excess(a: Expr, inverse_radius: Expr) -> Expr:
    """``e(a) = 1 - 1/max(|a|/M, 1)``: the share of ``a`` outside the ball ``|.| <= M``.

    ``e(a) a = a - P(a)`` with the projection ``P`` onto the ball, and ``e(a) |a| = [|a| - M]^+``.
    The argument is ``1/M``, so that the number 0 stands for an infinite radius and gives exactly 0.
    The maximum is taken of squares, so that neither the value nor its derivative divides by zero
    at ``a = 0``.
    """
    return 1.0 - 1.0 / ufl.sqrt(ufl.max_value(inverse_radius**2 * squared_norm(a), 1.0))


def normal_part(v: Expr, normal: Expr) -> Expr:
    """``v_nu = v . nu``, a scalar."""
    return ufl.inner(v, normal)


def tangential_part(v: Expr, normal: Expr) -> Expr:
    """``v_tau = v - (v . nu) nu``, a vector."""
    return v - normal_part(v, normal) * normal
