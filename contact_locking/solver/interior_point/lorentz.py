"""Algebra of Lorentz cones ``L = {(x_0, x_1): |x_1| <= x_0}``, in batches.

Arrays are (1 + m, k): k cones side by side, the first row x_0, so that every operation runs along
contiguous rows.  ``J = diag(1, -1, ..., -1)``, ``det x = x^T J x``, and
``x o z = (x . z, x_0 z_1 + z_0 x_1)`` is the Jordan product with unit ``e = (1, 0)``.  Formulae of
the scaling: Nesterov and Todd (1997), doi:10.1287/moor.22.1.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """``a . b`` of each column, (k,)."""
    return np.einsum("ik,ik->k", a, b)


def norm(a: FloatArray) -> FloatArray:
    """``|a|`` of each column, (k,)."""
    return np.sqrt(dot(a, a))


def size(x: FloatArray) -> FloatArray:
    """``sqrt(det x)`` (k,) of points inside the cone."""
    length = norm(x[1:])
    # As a product det x keeps its digits near the boundary of the cone.
    return np.sqrt((x[0] - length) * (x[0] + length))


def inverse(x: FloatArray) -> FloatArray:
    """``x^-1 = J x/det x``, so that ``x o x^-1 = e``."""
    result = x / -(size(x) ** 2)
    result[0] *= -1.0
    return result


def aligned(x: FloatArray, z: FloatArray, stays: BoolArray) -> tuple[FloatArray, FloatArray]:
    """A pair near by with ``x o z = theta e`` in each cone, with its own theta.

    Points x stay where ``stays`` (k,), and multipliers elsewhere; the other of the two becomes a
    multiple of the inverse of the one that stays, with the same first entry as before.
    """

    def beside(y: FloatArray, first: FloatArray) -> FloatArray:
        turned = -(first / y[0]) * y
        turned[0] = first
        return turned

    return np.where(stays, x, beside(z, x[0])), np.where(stays, beside(x, z[0]), z)


@dataclass(frozen=True)
class Scaling:
    """The Nesterov-Todd scaling of a pair (x, z): ``W z = W^-1 x = lambda``.

    ``W = eta (2 v v^T - J)`` and ``W^2 = eta^2 (2 w w^T - J)`` with ``w^T J w = 1``, so that
    ``v = (w + e)/sqrt(2 (w_0 + 1))``; ``point`` is lambda.  It ends where x or z change.
    """

    x: FloatArray
    z: FloatArray
    size_x: FloatArray
    size_z: FloatArray
    eta: FloatArray
    w: FloatArray
    point: FloatArray

    @classmethod
    def of(cls, x: FloatArray, z: FloatArray) -> Scaling:
        size_x, size_z = size(x), size(z)
        both = np.sqrt(size_x * size_z)
        gamma = np.sqrt(0.5 * (1.0 + dot(x, z) / (size_x * size_z)))
        x_0, z_0 = x[0] / size_x, z[0] / size_z
        w = (0.5 / (gamma * size_x)) * x - (0.5 / (gamma * size_z)) * z
        w[0] = 0.5 * (x_0 + z_0) / gamma
        share = both / (x_0 + z_0 + 2.0 * gamma)
        point = (share * (gamma + z_0) / size_x) * x + (share * (gamma + x_0) / size_z) * z
        point[0] = gamma * both
        return cls(x, z, size_x, size_z, np.sqrt(size_x / size_z), w, point)

    def aim(self, target: float, correction: FloatArray | None) -> FloatArray:
        """The b of ``dz = b - W^-2 dx`` that drives the scaled products to ``target e``.

        ``lambda o (W^-1 dx + W dz) = target e - lambda o lambda - correction`` leads to it, where
        ``W^-1 lambda = z`` and ``W^-1 lambda^-1 = x^-1``.
        """
        share = target / self.size_x**2
        b = -share * self.x
        b[0] *= -1.0
        b -= self.z
        if correction is not None:
            point, det = self.point, self.size_x * self.size_z
            first = (point[0] * correction[0] - dot(point[1:], correction[1:])) / det
            y = correction - first * point
            y *= 1.0 / point[0]
            y[0] = first
            b -= self._scaled(y, -1)
        return b

    def correction(self, dx: FloatArray, dz: FloatArray) -> FloatArray:
        """The second-order term of a step, ``W^-1 dx o W dz``."""
        a, b = self._scaled(dx, -1), self._scaled(dz, 1)
        product = a[0] * b
        product[1:] += b[0] * a[1:]
        product[0] = dot(a, b)
        return product

    def recentring(
        self, t: float, dx: FloatArray, dz: FloatArray, band: tuple[float, float]
    ) -> FloatArray:
        """The correction that brings the scaled products after a step t back into a band.

        ``W^-1 (x + t dx) o W (z + t dz)`` has the eigenvalues ``v_0 +- |v_1|``.  They are clipped
        (Gondzio, doi:10.1007/BF00249643), by the upper end of the band at most where they are
        large; the difference is what a correction has to aim at beside it.
        """
        product = self.correction(self.x + t * dx, self.z + t * dz)
        length = norm(product[1:])
        low, high = band
        least, most = (
            np.maximum(np.clip(v, low, high) - v, -high)
            for v in (product[0] - length, product[0] + length)
        )
        along = np.divide(most - least, length, out=np.zeros_like(length), where=length > 0.0)
        product[0] = most + least
        product[1:] *= along
        product *= 0.5
        return product

    def speeds(self, dx: FloatArray, dz: FloatArray) -> FloatArray:
        """The reciprocal (k,) of the longest step in each cone, 0 without a limit."""
        most: FloatArray = np.zeros_like(self.eta)
        for y, size_y, d in ((self.x, self.size_x, dx), (self.z, self.size_z, dz)):
            along = (y[0] * d[0] - dot(y[1:], d[1:])) / size_y
            across = ((along + d[0]) / (y[0] + size_y)) * y[1:]
            across -= d[1:]
            most = np.maximum(most, (norm(across) - along) / size_y)
        return most

    def _scaled(self, y: FloatArray, sign: int) -> FloatArray:
        """``W y`` for the sign +1, ``W^-1 y`` for -1: ``J w`` in the place of w, and 1/eta."""
        w, rest = self.w, sign * dot(self.w[1:], y[1:])
        result = sign * (y[0] + rest / (w[0] + 1.0)) * w
        result += y
        # The first row over eta is ``w . y``.
        result[0] = w[0] * y[0] + rest
        result *= self.eta if sign > 0 else 1.0 / self.eta
        return result
