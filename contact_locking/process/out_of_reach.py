"""The times of a process at which nothing is admissible."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import FloatArray
from contact_locking.parallel import maximum
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.task import SolverReport

# Values that differ by less than this share of the largest are the same.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class AdmissibilityData:
    """Data that decide which displacements are admissible at a time, on this rank.

    ``moving`` are prescribed displacements and gaps.  ``fixed`` are contact normals and the inverse
    limits of the strain: a user may change the limits between two steps.  Foundations that forces
    move do not count, because they may retreat.  Friction decides nothing here.
    """

    comm: MPI.Intracomm
    time: float
    moving: tuple[FloatArray, ...]
    fixed: tuple[FloatArray, ...]

    @classmethod
    def of(cls, system: PenalisedSystem, time: float) -> AdmissibilityData:
        """The data of the system, which has been set to the time."""
        contacts = [contact for contact in system.contacts if not contact.is_free]
        nothing = np.empty(0)
        gaps = np.concatenate([nothing, *(contact.gaps for contact in contacts)])
        normals = np.concatenate([nothing, *(item.normals.ravel() for item in contacts)])
        limits = np.concatenate([law.inverse_limit.x.array for law in system.data.sets])
        held = system.constraints.held_part(system.u.x.array)
        return cls(system.comm, time, (held, gaps), (normals, limits))

    def repeats(self, other: AdmissibilityData) -> bool:
        """Whether the same displacements are admissible as at another time; collective."""
        return self._agree(self.fixed, other.fixed) and self._agree(self.moving, other.moving)

    def is_beyond(self, refused: AdmissibilityData, reached: AdmissibilityData) -> bool:
        """Whether no displacement is admissible, because none is at ``refused``; collective.

        Some displacement is admissible at ``reached``.  Let ``refused`` mix the displacements and
        the gaps of ``reached`` and of these data, with all else the same.  If some displacement
        were admissible here, its mixture with that at ``reached`` would be admissible at
        ``refused``, because the limits are convex.
        """
        if not reached.time < refused.time <= self.time:
            return False
        if not all(self._agree(self.fixed, other.fixed) for other in (reached, refused)):
            return False
        share = (refused.time - reached.time) / (self.time - reached.time)
        pairs = zip(self.moving, reached.moving, strict=True)
        mixed = [there + share * (here - there) for here, there in pairs]
        return self._agree(mixed, refused.moving)

    def _agree(self, ours: Sequence[FloatArray], theirs: Sequence[FloatArray]) -> bool:
        return all(map(self._are_same, ours, theirs))

    def _are_same(self, ours: FloatArray, theirs: FloatArray) -> bool:
        # Sets of strains and contacts may be added between two steps.
        apart = np.abs(ours - theirs) if ours.shape == theirs.shape else np.array([np.inf])
        size = maximum(self.comm, np.abs(np.concatenate([ours, theirs])))
        return maximum(self.comm, apart) <= _ROUNDING * size


class OutOfReach:
    """Times for which a proof shows that no displacement of the mesh keeps the limits and the gaps.

    The proof uses only the :class:`AdmissibilityData` of the time.  So it does not depend on the
    steps before, nor on the slip that friction remembers.
    """

    def __init__(self) -> None:
        self._refused: list[tuple[AdmissibilityData, SolverReport]] = []
        self._reached: AdmissibilityData | None = None

    def add(self, data: AdmissibilityData, report: SolverReport) -> None:
        """Note a time if the report of its solve says that no displacement is admissible."""
        if report.is_infeasible:
            self._refused.append((data, report))

    def reach(self, data: AdmissibilityData) -> None:
        """Note a time at which a solution was found that is admissible."""
        self._reached = data

    def are_after(self, time: float) -> bool:
        """Whether there is such a time, at ``time`` or later."""
        return any(data.time >= time for data, _ in self._refused)

    def excludes(self, data: AdmissibilityData) -> bool:
        """Whether the proofs for other times exclude all displacements; collective."""
        reached = self._reached
        return any(
            data.repeats(refused) or (reached is not None and data.is_beyond(refused, reached))
            for refused, _ in self._refused
        )

    def explained(self, reason: str, at: float, reached: float) -> dict[str, str]:
        """The reason and the suggestion of a process that ends before a time that is out of reach.

        Its last step failed to get to the time ``at``, where a solve may fail for a ``reason`` that
        says little, as this is close to the largest load that can be followed.  ``reached`` is the
        time of the last solution, -inf without one.  Empty if no later time is out of reach.
        """
        ahead = [pair for pair in self._refused if pair[0].time > reached]
        if not ahead:
            return {}
        data, report = min(ahead, key=lambda pair: pair[0].time)
        told = [f"{report.reason}, at t = {data.time:.6g}"]
        if reached > -math.inf:
            told.append(f"the last time that was reached is t = {reached:.6g}")
        if data.time > at:
            told.append(f"the step to t = {at:.6g} did not converge: {reason}")
        return {"reason": "; ".join(told), "suggestion": report.suggestion}
