"""Types of NumPy arrays, the names of the axes, and moments of forces."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
import numpy.typing as npt

S = TypeVar("S", bound=np.generic)

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
#: The local numbers of cells, facets and degrees of freedom have 32 bits in DOLFINx.
IndexArray = npt.NDArray[np.int32]
BoolArray = npt.NDArray[np.bool_]

AXES = ("x", "y", "z")
#: Bounds of the absolute values of quantities, and of divisors.  No quantity reaches them in any
#: unit, and products of three such values stay in the range of double precision.
LARGEST, SMALLEST = 1e100, 1e-100


def moments(x: FloatArray, forces: FloatArray) -> FloatArray:
    """``x cross F`` of forces (k, d) at points (k, d): (k, 1) in 2D, (k, 3) in 3D."""
    if x.shape[1] == 2:
        return np.asarray(x[:, :1] * forces[:, 1:] - x[:, 1:] * forces[:, :1])
    return np.asarray(np.cross(x, forces), dtype=np.float64)


def flattened(values: npt.NDArray[S], kept: int = 0) -> npt.NDArray[S]:
    """Values (n, ...) as (n, m), the last ``kept`` axes as they are.

    A rank without cells has n = 0, where ``reshape(n, -1)`` leaves m open.
    """
    end = values.ndim - kept
    return values.reshape(len(values), math.prod(values.shape[1:end]), *values.shape[end:])
