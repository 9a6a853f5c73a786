"""Algebra of Lorentz cones ``L = {(x_0, x_1): |x_1| <= x_0}``, in batches.

Arrays are (1 + m, k): k cones side by side, the first row x_0, so that every operation runs along
contiguous rows.  ``J = diag(1, -1, ..., -1)``, ``det x = x^T J x``, and
``x o z = (x . z, x_0 z_1 + z_0 x_1)`` is the Jordan product with unit ``e = (1, 0)``.  Formulae of
the scaling: Nesterov and Todd (1997), doi:10.1287/moor.22.1.1.

What is needed several times per iteration is compiled from lorentz.c: one pass over the data
instead of one for each operation of NumPy, which took a seventh of a solve in 2D.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import FloatArray
from contact_locking.fem import compiled

# A point and its multiplier, or a step of both.
Pair: TypeAlias = tuple[FloatArray, FloatArray]


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """``a . b`` of each column, (k,)."""
    return np.einsum("ik,ik->k", a, b)


def norm(a: FloatArray) -> FloatArray:
    """``|a|`` of each column, (k,)."""
    return np.sqrt(dot(a, a))


class Lorentz:
    """The compiled algebra; collective to make."""

    def __init__(self, comm: MPI.Intracomm) -> None:
        self._library, self._ffi = compiled.library_of(__package__, "lorentz", comm)

    def size(self, x: FloatArray) -> FloatArray:
        """``sqrt(det x)`` (k,) of points inside the cone."""
        size = np.empty(x.shape[1])
        self.call("lorentz_size", *x.shape, x, size)
        return size

    def inverse(self, x: FloatArray) -> FloatArray:
        """``x^-1 = J x/det x``, so that ``x o x^-1 = e``."""
        result = x / -(self.size(x) ** 2)
        result[0] *= -1.0
        return result

    def total(self, weights: FloatArray, pair: Pair, t: float, step: Pair) -> float:
        """``sum weights (x + t dx) . (z + t dz)``."""
        return float(self.call("lorentz_total", *pair[0].shape, t, weights, *pair, *step))

    def call(self, name: str, rows: int, count: int, *arguments: FloatArray | float | None) -> Any:
        """A function of lorentz.c for points (rows, count); None is NULL.

        Raises ValueError for an array that is none of such points, since C would read beyond it.
        """
        sizes = {count, (rows - 1) * count, rows * count}

        def given(value: FloatArray | float | None) -> Any:
            if value is None:
                return self._ffi.NULL
            if not isinstance(value, np.ndarray):
                return value
            if value.dtype != np.float64 or value.size not in sizes:
                raise ValueError(f"{name}: {value.dtype} {value.shape} for points {rows, count}")
            return self._ffi.from_buffer("double[]", value)

        return getattr(self._library, name)(rows, count, *map(given, arguments))


@dataclass(frozen=True)
class Scaling:
    """The Nesterov-Todd scaling of a pair (x, z): ``W z = W^-1 x = lambda``.

    ``W = eta (2 v v^T - J)`` and ``W^2 = eta^2 (2 w w^T - J)`` with ``w^T J w = 1``, so that
    ``v = (w + e)/sqrt(2 (w_0 + 1))``; ``point`` is lambda.  It ends where x or z change.
    """

    lorentz: Lorentz
    x: FloatArray
    z: FloatArray
    size_x: FloatArray
    size_z: FloatArray
    eta: FloatArray
    w: FloatArray
    point: FloatArray

    @classmethod
    def of(cls, lorentz: Lorentz, x: FloatArray, z: FloatArray) -> Scaling:
        size_x, size_z = lorentz.size(x), lorentz.size(z)
        eta, w, point = np.empty_like(size_x), np.empty_like(x), np.empty_like(x)
        lorentz.call("lorentz_scaling", *x.shape, x, z, size_x, size_z, eta, w, point)
        return cls(lorentz, x, z, size_x, size_z, eta, w, point)

    def aim(self, target: float, correction: FloatArray | None) -> FloatArray:
        """The b of ``dz = b - W^-2 dx`` that drives the scaled products to ``target e``.

        ``lambda o (W^-1 dx + W dz) = target e - lambda o lambda - correction`` leads to it, where
        ``W^-1 lambda = z`` and ``W^-1 lambda^-1 = x^-1``.
        """
        b = np.empty_like(self.x)
        sizes = self.size_x, self.size_z
        how = self.eta, self.w, self.point, correction
        self.lorentz.call("lorentz_aim", *b.shape, target, self.x, self.z, *sizes, *how, b)
        return b

    def correction(self, dx: FloatArray, dz: FloatArray) -> FloatArray:
        """The second-order term of a step, ``W^-1 dx o W dz``."""
        return self._product(0.0, dx, dz, dx, dz)

    def recentring(
        self, t: float, dx: FloatArray, dz: FloatArray, band: tuple[float, float]
    ) -> FloatArray:
        """What brings the scaled products after a step of length t back into a band.

        ``W^-1 (x + t dx) o W (z + t dz)`` has the eigenvalues ``v_0 +- |v_1|``.  They are clipped
        (Gondzio, doi:10.1007/BF00249643), by the upper end of the band at most where they are
        large; the difference is what a correction has to aim at beside it.
        """
        products = self._product(t, self.x, self.z, dx, dz)
        change = np.empty_like(products)
        self.lorentz.call("lorentz_into_band", *change.shape, *band, products, change)
        return change

    def longest_step(self, step: Pair, other: Pair, share: float = 0.0) -> float:
        """The largest t with ``(x, z) + t (step + share (other - step))`` in every cone.

        Infinite without a limit.
        """
        sides = (self.x, self.size_x), (self.z, self.size_z)
        speeds = [
            self.lorentz.call("lorentz_speed", *one.shape, share, *side, one, another, None)
            for side, one, another in zip(sides, step, other, strict=True)
        ]
        speed = np.max(speeds)
        # NaN is no direction to go in.
        return np.inf if speed <= 0.0 else 1.0 / speed if speed > 0.0 else 0.0

    def speeds(self, step: Pair) -> FloatArray:
        """The reciprocal (k,) of the longest step in each cone; none is negative."""
        found = np.zeros(self.x.shape[1])
        for y, size, dy in zip((self.x, self.z), (self.size_x, self.size_z), step, strict=True):
            self.lorentz.call("lorentz_speed", *dy.shape, 0.0, y, size, dy, dy, found)
        return found

    def _product(
        self, t: float, x: FloatArray, z: FloatArray, dx: FloatArray, dz: FloatArray
    ) -> FloatArray:
        result = np.empty_like(dx)
        self.lorentz.call("lorentz_product", *dx.shape, t, x, z, dx, dz, self.eta, self.w, result)
        return result
