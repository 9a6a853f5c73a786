"""Algebra of Lorentz cones ``L = {(x_0, x_1): |x_1| <= x_0}``, in batches.

Arrays are (1 + m, k): k cones side by side, the first row x_0, so that every operation runs along
contiguous rows.  ``J = diag(1, -1, ..., -1)``, ``det x = x^T J x``, and
``x o z = (x . z, x_0 z_1 + z_0 x_1)`` is the Jordan product with unit ``e = (1, 0)``.  Formulae of
the scaling: Nesterov and Todd (1997), doi:10.1287/moor.22.1.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """``a . b`` of each column, (k,)."""
    return np.einsum("ik,ik->k", a, b)


def norm(a: FloatArray) -> FloatArray:
    """``|a|`` of each column, (k,)."""
    return np.sqrt(dot(a, a))


def det(x: FloatArray) -> FloatArray:
    """``x_0^2 - |x_1|^2`` as a product, which keeps its digits near the boundary of the cone."""
    size = norm(x[1:])
    return (x[0] - size) * (x[0] + size)


def reflect(x: FloatArray) -> FloatArray:
    """``J x``."""
    result = -x
    result[0] = x[0]
    return result


def product(x: FloatArray, z: FloatArray) -> FloatArray:
    """The Jordan product ``x o z``."""
    result = x[0] * z
    result[1:] += z[0] * x[1:]
    result[0] = dot(x, z)
    return result


def divide(d: FloatArray, x: FloatArray) -> FloatArray:
    """The solution y of ``x o y = d`` for x inside the cone."""
    result = np.empty_like(d)
    result[0] = (x[0] * d[0] - dot(x[1:], d[1:])) / det(x)
    result[1:] = (d[1:] - result[0] * x[1:]) / x[0]
    return result


def inverse(x: FloatArray) -> FloatArray:
    """``x^-1 = J x/det x``, so that ``x o x^-1 = e``."""
    return Unit.of(x).inverse


@dataclass(frozen=True)
class Unit:
    """Points inside the cone as ``size`` (k,) times ``direction`` (1 + m, k) of determinant one."""

    size: FloatArray
    direction: FloatArray

    @classmethod
    def of(cls, x: FloatArray) -> Unit:
        size = np.sqrt(det(x))
        return cls(size, x / size)

    @cached_property
    def inverse(self) -> FloatArray:
        """``x^-1 = J x/det x``."""
        return reflect(self.direction) / self.size

    def longest_step(self, step: FloatArray) -> float:
        """The largest t with ``x + t step`` in every cone, inf if there is no limit."""
        if not step.shape[1]:
            return np.inf
        e = self.direction
        along = e[0] * step[0] - dot(e[1:], step[1:])
        across = ((along + step[0]) / (e[0] + 1.0)) * e[1:]
        across -= step[1:]
        speed = np.max((norm(across) - along) / self.size)
        # NaN is no direction to go in.
        return np.inf if speed <= 0.0 else 1.0 / speed if speed > 0.0 else 0.0


@dataclass(frozen=True)
class Scaling:
    """The Nesterov-Todd scaling of a pair (x, z): ``W z = W^-1 x = lambda``.

    ``W = eta (2 v v^T - J)`` and ``W^2 = eta^2 (2 w w^T - J)`` with ``w^T J w = 1``; ``point`` is
    lambda.
    """

    x: Unit
    z: Unit
    eta: FloatArray
    w: FloatArray
    v: FloatArray
    point: FloatArray

    @classmethod
    def of(cls, x: FloatArray, z: FloatArray) -> Scaling:
        unit_x, unit_z = Unit.of(x), Unit.of(z)
        x_unit, z_unit = unit_x.direction, unit_z.direction
        gamma = np.sqrt(0.5 * (1.0 + dot(x_unit, z_unit)))
        w = (x_unit + reflect(z_unit)) / (2.0 * gamma)
        v = w.copy()
        v[0] += 1.0
        v /= np.sqrt(2.0 * v[0])
        total = x_unit[0] + z_unit[0] + 2.0 * gamma
        point = np.empty_like(x)
        point[0] = gamma
        point[1:] = ((gamma + z_unit[0]) / total) * x_unit[1:]
        point[1:] += ((gamma + x_unit[0]) / total) * z_unit[1:]
        point *= np.sqrt(unit_x.size * unit_z.size)
        return cls(unit_x, unit_z, np.sqrt(unit_x.size / unit_z.size), w, v, point)

    def apply(self, y: FloatArray) -> FloatArray:
        """``W y``."""
        result = 2.0 * dot(self.v, y) * self.v
        result[0] -= y[0]
        result[1:] += y[1:]
        result *= self.eta
        return result

    def apply_inverse(self, y: FloatArray) -> FloatArray:
        """``W^-1 y``."""
        # J v takes the place of v.
        along = 2.0 * (self.v[0] * y[0] - dot(self.v[1:], y[1:]))
        result = along * self.v
        result[0] -= y[0]
        np.subtract(y[1:], result[1:], out=result[1:])
        result /= self.eta
        return result
