"""A solved state to go on from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from contact_locking.solver.penalty import Penalty
from contact_locking.system import PenalisedSystem

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SavedState:
    """What solved some problem on this mesh with the penalty parameters ``penalty``.

    ``displacement`` holds local values, ghosts included, ``pressure`` (k,) those at the owned nodes
    of Gamma_C, None where nothing is known of it.
    """

    displacement: FloatArray
    pressure: FloatArray | None
    penalty: Penalty

    def enter(self, system: PenalisedSystem) -> None:
        """Put displacement and friction bound into ``system``; collective."""
        system.take_over(self.displacement, self.pressure)
