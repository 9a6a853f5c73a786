"""The locking stress, contact pressure and friction traction as unknowns of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import fem

from contact_locking.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class ContactForces:
    """Pressure (k,) and ``-sigma_tau`` (k, d) at the owned nodes of one part of Gamma_C.

    ``touches`` (k,) says where the body is in contact; elsewhere the pressure vanishes up to the
    solver's tolerance only.
    """

    pressure: FloatArray
    friction: FloatArray
    touches: BoolArray

    @classmethod
    def none(cls, nodes: int, dim: int) -> ContactForces:
        """No forces at so many nodes."""
        return cls(np.zeros(nodes), np.zeros((nodes, dim)), np.zeros(nodes, dtype=bool))


@dataclass(frozen=True)
class Multipliers:
    """Z in the space of strains, and the forces on each part of Gamma_C."""

    locking_stress: fem.Function
    contacts: tuple[ContactForces, ...]
