"""A solved state to go on from."""

from __future__ import annotations

from dataclasses import dataclass

from contact_locking.arrays import FloatArray
from contact_locking.laws.penalty import Penalty
from contact_locking.problem.system import PenalisedSystem


@dataclass(frozen=True)
class SavedState:
    """The solution of some problem on this mesh with the penalty parameters ``penalty``.

    ``displacement`` holds local values, ghosts included, ``pressures`` those (k,) at the owned
    nodes of each contact; without any, nothing is known of them.  ``slips`` holds the lengths (k,)
    of the slip in the step of a process that ended with this state, and ``travels`` those of the
    tools.
    """

    displacement: FloatArray
    pressures: tuple[FloatArray, ...]
    penalty: Penalty
    slips: tuple[FloatArray, ...] = ()
    travels: tuple[float, ...] = ()

    def enter(self, system: PenalisedSystem) -> None:
        """Put displacement, travels and friction bounds into ``system``; collective."""
        travels = self.travels if len(self.travels) == len(system.tools) else ()
        system.take_over(self.displacement, self.pressures, travels)
