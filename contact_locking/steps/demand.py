"""What a time of a process asks of the body, whatever friction remembers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import FloatArray
from contact_locking.parallel import maximum
from contact_locking.problem.system import PenalisedSystem

# Values that differ by less than this share of the largest are the same.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Demand:
    """Prescribed displacements, gaps and contact normals at a time, on this rank.

    Together with the limits of the strain, which are the same at all times, they decide what is
    admissible.  Tools that a force pushes ask for nothing, as they may retreat.
    """

    comm: MPI.Intracomm
    time: float
    displacements: FloatArray
    gaps: FloatArray
    normals: FloatArray

    @classmethod
    def of(cls, system: PenalisedSystem, time: float) -> Demand:
        """The demand of the time that the system has been put to."""
        contacts = [contact for contact in system.contacts if not contact.is_pushed]
        return cls(
            comm=system.comm,
            time=time,
            displacements=system.constraints.held_part(system.u.x.array),
            gaps=np.concatenate([np.empty(0), *(contact.gaps for contact in contacts)]),
            normals=np.concatenate([np.empty(0), *(item.normals.ravel() for item in contacts)]),
        )

    def is_beyond(self, refused: Demand, reached: Demand) -> bool:
        """Whether nothing is admissible, as nothing is at ``refused``; collective.

        Something is at ``reached``.  If ``refused`` mixes the displacements and the gaps of
        ``reached`` and of this demand, and all normals are the same, then the mixture of what is
        admissible at both would be admissible at ``refused``, because the limits are convex.
        """
        if not reached.time < refused.time <= self.time:
            return False
        share = (refused.time - reached.time) / (self.time - reached.time)

        def is_mixed(ours: FloatArray, middle: FloatArray, theirs: FloatArray) -> bool:
            size = maximum(self.comm, np.abs(np.concatenate([ours, theirs])))
            left = maximum(self.comm, np.abs(theirs + share * (ours - theirs) - middle))
            return left <= _ROUNDING * size

        return (
            maximum(self.comm, np.abs(self.normals - reached.normals)) <= _ROUNDING
            and maximum(self.comm, np.abs(self.normals - refused.normals)) <= _ROUNDING
            and is_mixed(self.displacements, refused.displacements, reached.displacements)
            and is_mixed(self.gaps, refused.gaps, reached.gaps)
        )
