"""The locking stress, contact pressures and friction tractions as unknowns of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import fem

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ContactForces:
    """At the owned nodes of a contact: ``pressure`` (k,) and ``friction = -sigma_tau`` (k, d).

    ``touches`` (k,) says where the body is in contact; elsewhere the pressure vanishes up to the
    solver's tolerance only.
    """

    pressure: FloatArray
    friction: FloatArray
    touches: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Multipliers:
    """Z as a P0 function, and the forces of each contact."""

    locking_stress: fem.Function
    contacts: tuple[ContactForces, ...]
