"""Lorentz cones side by side, cone by cone as the definitions say."""

from __future__ import annotations

import math

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.lorentz import Scaling


def inside(random: np.random.Generator, size: int, count: int) -> FloatArray:
    """Points of ``size`` components inside their cones."""
    x = random.standard_normal((size, count))
    x[0] = np.linalg.norm(x[1:], axis=0) + random.uniform(1e-6, 2.0, count)
    return x


def product(x: FloatArray, z: FloatArray) -> FloatArray:
    """``x o z``."""
    return np.vstack([np.sum(x * z, axis=0), x[0] * z[1:] + z[0] * x[1:]])


def unit(size: int, count: int) -> FloatArray:
    """``e``."""
    return np.eye(size)[:, [0] * count]


def scaled(scaling: Scaling, y: FloatArray, power: int) -> FloatArray:
    """``W y`` or ``W^-1 y`` (power -1), with W as a matrix for each cone."""
    J = np.diag([1.0] + [-1.0] * (len(y) - 1))
    result = np.empty_like(y)
    for j in range(y.shape[1]):
        v = scaling.w[:, j] + unit(len(y), 1)[:, 0]
        v /= math.sqrt(2.0 * v[0])
        W = scaling.eta[j] * (2.0 * np.outer(v, v) - J)
        result[:, j] = W @ y[:, j] if power == 1 else np.linalg.solve(W, y[:, j])
    return result
