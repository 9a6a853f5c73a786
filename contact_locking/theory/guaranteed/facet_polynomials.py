"""Polynomials on facets by their control values, those of Bernstein's basis.

Control values that are not negative belong to a polynomial that is not negative, and the lengths of
control vectors bound the length of a vector polynomial.  For affine polynomials the control values
are the values at the ends.
"""

from __future__ import annotations

import basix
import numpy as np
from scipy.special import comb

from contact_locking.arrays import FloatArray
from contact_locking.theory.guaranteed.macro_element import legendre


def bernstein(degree: int, s: FloatArray) -> FloatArray:
    """Bernstein's polynomials (..., r + 1) of degree r on [0, 1] at points s (...,)."""
    i, x = np.arange(degree + 1), s[..., None]
    return np.asarray(comb(degree, i) * x**i * (1.0 - x) ** (degree - i))


def control_values(nodal: FloatArray) -> FloatArray:
    """The control values (m, r + 1) of values at the r + 1 equidistant points of facets."""
    degree = nodal.shape[1] - 1
    return nodal @ np.linalg.inv(bernstein(degree, np.arange(degree + 1) / degree)).T


def legendre_moments(control: FloatArray, degree: int) -> FloatArray:
    """The moments (m, k + 1, ...) on [0, 1] with Legendre's polynomials up to degree k."""
    own = control.shape[1] - 1
    s, weights = _rule(own + degree)
    table = np.einsum("q,qj,qi->ji", weights, legendre(degree, s), bernstein(own, s))
    return np.einsum("ji,mi...->mj...", table, control)


def product_integral(a: FloatArray, b: FloatArray) -> FloatArray:
    """``int_0^1 a b`` (m,) for control values a (m, r + 1) and b (m, q + 1)."""
    da, db = a.shape[1] - 1, b.shape[1] - 1
    s, weights = _rule(da + db)
    table = np.einsum("q,qi,qj->ij", weights, bernstein(da, s), bernstein(db, s))
    return np.einsum("mi,ij,mj->m", a, table, b)


def absolute_integral(a: FloatArray, b: FloatArray) -> FloatArray:
    """``int_0^1 a |b|`` (m,) for control values a (m, r + 1), and b (m, 2) or (m, 3).

    The interval is divided at the zeros of b, so that the integral is exact.
    """
    da, db = a.shape[1] - 1, b.shape[1] - 1
    cuts = np.column_stack([np.zeros(len(b)), _zeros(b), np.ones(len(b))])
    points, weights = _rule(da + db)
    sizes = np.diff(cuts)
    s = cuts[:, :-1, None] + points * sizes[:, :, None]
    first = np.einsum("mcqi,mi->mcq", bernstein(da, s), a)
    second = np.einsum("mcqi,mi->mcq", bernstein(db, s), b)
    return np.asarray(np.sum((first * np.abs(second)) @ weights * sizes, axis=1))


def _rule(degree: int) -> tuple[FloatArray, FloatArray]:
    points, weights = basix.make_quadrature(basix.CellType.interval, degree)
    return points[:, 0], weights


def _zeros(b: FloatArray) -> FloatArray:
    """The zeros of polynomials in (0, 1), in ascending order; 0 or 1 in place of the others."""
    if b.shape[1] == 2:
        b = np.column_stack([b[:, 0], b.mean(axis=1), b[:, 1]])
    # b0 (1 - s)^2 + 2 b1 s (1 - s) + b2 s^2 = p s^2 - 2 q s + b0.
    p, q, c = b[:, 0] - 2.0 * b[:, 1] + b[:, 2], b[:, 0] - b[:, 1], b[:, 0]
    root = np.sqrt(np.maximum(q * q - p * c, 0.0))
    far = q + np.where(q >= 0.0, root, -root)
    first = np.divide(far, p, out=np.zeros_like(p), where=np.abs(p) > 1e-300)
    second = np.divide(c, far, out=np.zeros_like(p), where=np.abs(far) > 1e-300)
    return np.sort(np.clip(np.column_stack([first, second]), 0.0, 1.0), axis=1)
