"""The locking stress, contact pressure and friction traction as unknowns of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import fem

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Multipliers:
    """Z as a P0 function, and at the owned nodes of Gamma_C pressure (k,) and -sigma_tau (k, d).

    ``touches`` (k,) says where the body is in contact; elsewhere the pressure vanishes up to the
    solver's tolerance only.
    """

    locking_stress: fem.Function
    pressure: FloatArray
    friction: FloatArray
    touches: npt.NDArray[np.bool_]
