"""The locking stress, contact pressure and friction traction as unknowns of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import fem

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Multipliers:
    """``locking_stress`` is Z (P0); ``pressure`` (k,) and ``friction`` = -sigma_tau (k, d) nodal."""

    locking_stress: fem.Function
    pressure: FloatArray
    friction: FloatArray
