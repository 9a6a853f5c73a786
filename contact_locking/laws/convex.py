"""The few pieces of convex analysis that every law is made of, in UFL, each named once.

All of them are differentiable by UFL without a division by zero: where a norm can vanish it is
taken of a quantity that is bounded away from zero.
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
    """``1 - 1/max(|a|/M, 1)``: the share of ``a`` that sticks out of the ball ``|.| <= M``.

    ``excess * a = a - P(a)`` with ``P`` the projection onto the ball, and
    ``excess * |a| = [|a| - M]^+``.  The radius enters as ``1/M`` so that an infinite radius is
    the number 0 and gives exactly 0; the maximum is taken of squares so that neither the value
    nor its derivative divides by zero at ``a = 0``.
    """
    return 1.0 - 1.0 / ufl.sqrt(ufl.max_value(inverse_radius**2 * squared_norm(a), 1.0))


def normal_part(v: Expr, normal: Expr) -> Expr:
    """``v_nu = v . nu``, a scalar."""
    return ufl.inner(v, normal)


def tangential_part(v: Expr, normal: Expr) -> Expr:
    """``v_tau = v - (v . nu) nu``, a vector."""
    return v - normal_part(v, normal) * normal


def regularised_norm(v: Expr, epsilon: Expr) -> Expr:
    """``Psi_eps(v) = sqrt(|v|^2 + eps^2)`` for ``eps > 0`` (21)."""
    return ufl.sqrt(squared_norm(v) + epsilon**2)
