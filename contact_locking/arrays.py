"""The types of NumPy arrays in signatures, and the names of the coordinate axes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
#: The local numbers of cells, facets and degrees of freedom have 32 bits in DOLFINx.
IndexArray = npt.NDArray[np.int32]
BoolArray = npt.NDArray[np.bool_]

AXES = ("x", "y", "z")
