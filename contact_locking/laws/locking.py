"""The locking law: limits of the strain and their penalties, by functions of convex analysis.

The limit of the paper is the ball ``|eps| <= M`` with the penalty R_n (23).  A limit
``|L eps| <= M`` with a linear map L has the same penalty of ``L eps``, and a limit ``s <= M`` of a
scalar ``s = N : eps`` has the penalty :func:`one_sided_energy`.  All functions take and return UFL,
which can differentiate each without a division by zero: no norm is taken of a quantity that can
vanish.
"""

from __future__ import annotations

import math

import ufl
from ufl.core.expr import Expr

from contact_locking.laws.elasticity import mandel_product


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


def locking_stress(eps: Expr, inverse_limit: Expr, n: Expr) -> Expr:
    """``R_n(eps) = 2 n [|eps| - M]^+ eps/|eps| = 2 n (1 - 1/max(|eps|/M, 1)) eps`` (23).

    ``inverse_limit`` is ``1/M``, and 0 where the body does not lock; ``n`` has the unit of a
    stress. The result is a (d, d) tensor, exactly zero where ``|eps| <= M``.
    """
    return 2.0 * n * unit_ball_excess(eps, inverse_limit) * eps


def locking_energy(eps: Expr, inverse_limit: Expr, n: Expr) -> Expr:
    """``n ([|eps| - M]^+)^2``, the density whose derivative is :func:`locking_stress`."""
    return n * unit_ball_excess(eps, inverse_limit) ** 2 * squared_norm(eps)


def one_sided_energy(s: Expr, inverse_limit: Expr, n: Expr) -> Expr:
    """``n ([s - M]^+)^2``, the density of the penalty of a limit ``s <= M``."""
    return n * _one_sided_excess(s, inverse_limit) ** 2


def _one_sided_excess(s: Expr, inverse_limit: Expr) -> Expr:
    """``[s - M]^+`` as ``(1 - 1/max(s/M, 1)) [s]^+``, which takes 1/M."""
    return (1.0 - 1.0 / ufl.max_value(inverse_limit * s, 1.0)) * positive_part(s)


def deviator(eps: Expr) -> Expr:
    """``L eps = eps - t tr(eps) I`` with ``|L eps|^2 = |eps|^2 - tr(eps)^2/3``.

    In three dimensions this is the deviator.  In two dimensions ``|L eps|`` is the norm of the
    deviator of the three-dimensional strain with ``eps_zz = 0``, as in plane strain.
    """
    dim = eps.ufl_shape[0]
    # 2 t - d t^2 = 1/3.
    share = (1.0 - math.sqrt(1.0 - dim / 3.0)) / dim
    return eps - share * ufl.tr(eps) * ufl.Identity(dim)


def weighted(eps: Expr, matrix: Expr) -> Expr:
    """``C eps`` for a matrix C in Mandel's notation, as a symmetric (d, d) tensor."""
    return mandel_product(matrix, eps)
