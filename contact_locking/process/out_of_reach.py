"""The times of a process at which nothing is admissible."""

from __future__ import annotations

from contact_locking.process.admissibility_data import AdmissibilityData
from contact_locking.results.solution import StudySolution
from contact_locking.solver.task import SolverReport


class OutOfReach:
    """Times for which a proof shows that no displacement of the mesh keeps the limits and the gaps.

    The proof uses only the :class:`AdmissibilityData` of the time.  So it does not depend on the
    steps before, nor on the slip that friction remembers.
    """

    def __init__(self) -> None:
        self._refused: list[AdmissibilityData] = []
        self._reached: AdmissibilityData | None = None
        # The first planned time among those refused.
        self._planned: tuple[float, SolverReport] | None = None

    def add(self, data: AdmissibilityData, report: SolverReport, is_planned: bool) -> None:
        """Note a time if the report of its solve says that no displacement is admissible."""
        if not report.is_infeasible:
            return
        self._refused.append(data)
        if is_planned and self._planned is None:
            self._planned = data.time, report

    def reach(self, data: AdmissibilityData) -> None:
        """Note a time at which a solution was found that is admissible."""
        self._reached = data

    def excludes(self, data: AdmissibilityData) -> bool:
        """Whether the proofs for other times exclude all displacements; collective."""
        reached = self._reached
        return any(
            data.repeats(refused) or (reached is not None and data.is_beyond(refused, reached))
            for refused in self._refused
        )

    def tell(self, last: StudySolution, at: float) -> None:
        """Let the last solution, which failed to get to a time, name the planned time, if any.

        Halved steps then end close to the largest load that can be followed, where a solve may
        fail for reasons that say little.
        """
        if self._planned is None:
            return
        time, report = self._planned
        last.summary["reason"] = (
            f"{report.reason}; so at t = {time:.6g}, and the last step that was tried, to "
            f"t = {at:.6g}, did not converge: {last.summary['reason']}"
        )
        last.summary["suggestion"] = report.suggestion
