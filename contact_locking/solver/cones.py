"""Algebra of Lorentz cones ``L = {(x_0, x_1): |x_1| <= x_0}``, in batches.

Arrays are (k, 1 + m): k cones, the first column x_0.  ``J = diag(1, -1, ..., -1)``, ``det x =
x^T J x``, and ``x o z = (x . z, x_0 z_1 + z_0 x_1)`` is the Jordan product with unit
``e = (1, 0)``.  Formulae of the scaling: Nesterov and Todd (1997), doi:10.1287/moor.22.1.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """``a . b`` of each row, (k,)."""
    return np.einsum("ki,ki->k", a, b)


def det(x: FloatArray) -> FloatArray:
    """``x_0^2 - |x_1|^2`` as a product, which keeps its digits near the boundary of the cone."""
    norm = np.linalg.norm(x[:, 1:], axis=1)
    return (x[:, 0] - norm) * (x[:, 0] + norm)


def reflect(x: FloatArray) -> FloatArray:
    """``J x``."""
    result = -x
    result[:, 0] = x[:, 0]
    return result


def product(x: FloatArray, z: FloatArray) -> FloatArray:
    """The Jordan product ``x o z``."""
    result = x[:, :1] * z + z[:, :1] * x
    result[:, 0] = dot(x, z)
    return result


def divide(d: FloatArray, x: FloatArray) -> FloatArray:
    """The solution y of ``x o y = d`` for x inside the cone."""
    result = np.empty_like(d)
    result[:, 0] = (x[:, 0] * d[:, 0] - dot(x[:, 1:], d[:, 1:])) / det(x)
    result[:, 1:] = (d[:, 1:] - result[:, :1] * x[:, 1:]) / x[:, :1]
    return result


def inverse(x: FloatArray) -> FloatArray:
    """``x^-1 = J x/det x``, so that ``x o x^-1 = e``."""
    return reflect(x) / det(x)[:, None]


def longest_step(x: FloatArray, step: FloatArray) -> float:
    """The largest t with ``x + t step`` in every cone, inf if there is no limit."""
    if not len(x):
        return np.inf
    size = np.sqrt(det(x))
    unit = x / size[:, None]
    along = unit[:, 0] * step[:, 0] - dot(unit[:, 1:], step[:, 1:])
    across = step[:, 1:] - ((along + step[:, 0]) / (unit[:, 0] + 1.0))[:, None] * unit[:, 1:]
    speed = np.max((np.linalg.norm(across, axis=1) - along) / size)
    # NaN is no direction to go in.
    return np.inf if speed <= 0.0 else 1.0 / speed if speed > 0.0 else 0.0


@dataclass(frozen=True)
class Scaling:
    """The Nesterov-Todd scaling of a pair (x, z): ``W z = W^-1 x = lambda``.

    ``W = eta (2 v v^T - J)`` and ``W^2 = eta^2 (2 w w^T - J)`` with ``w^T J w = 1``.
    """

    eta: FloatArray
    w: FloatArray
    v: FloatArray
    point: FloatArray

    @classmethod
    def of(cls, x: FloatArray, z: FloatArray) -> Scaling:
        det_x, det_z = np.sqrt(det(x)), np.sqrt(det(z))
        x_unit, z_unit = x / det_x[:, None], z / det_z[:, None]
        gamma = np.sqrt(0.5 * (1.0 + dot(x_unit, z_unit)))
        w = (x_unit + reflect(z_unit)) / (2.0 * gamma)[:, None]
        v = w.copy()
        v[:, 0] += 1.0
        v /= np.sqrt(2.0 * (w[:, 0] + 1.0))[:, None]
        total = x_unit[:, 0] + z_unit[:, 0] + 2.0 * gamma
        point = np.empty_like(x)
        point[:, 0] = gamma
        point[:, 1:] = ((gamma + z_unit[:, 0]) / total)[:, None] * x_unit[:, 1:] + (
            (gamma + x_unit[:, 0]) / total
        )[:, None] * z_unit[:, 1:]
        point *= np.sqrt(det_x * det_z)[:, None]
        return cls(np.sqrt(det_x / det_z), w, v, point)

    def apply(self, y: FloatArray) -> FloatArray:
        """``W y``."""
        return self.eta[:, None] * (2.0 * dot(self.v, y)[:, None] * self.v - reflect(y))

    def apply_inverse(self, y: FloatArray) -> FloatArray:
        """``W^-1 y``."""
        v = reflect(self.v)
        return (2.0 * dot(v, y)[:, None] * v - reflect(y)) / self.eta[:, None]
