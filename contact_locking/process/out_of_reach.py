"""The times of a process at which nothing is admissible."""

from __future__ import annotations

from contact_locking.process.demand import Demand
from contact_locking.results.solution import StudySolution
from contact_locking.solver.solver_report import SolverReport


class OutOfReach:
    """Times with the proof that no displacement of the mesh keeps the limits and the gaps then.

    The proof knows nothing but the :class:`Demand` of the time.  So it holds whatever the steps
    before were, and whatever friction remembers.
    """

    def __init__(self) -> None:
        self._refused: list[Demand] = []
        self._reached: Demand | None = None
        # The first planned time among those refused.
        self._planned: tuple[float, SolverReport] | None = None

    def add(self, demand: Demand, report: SolverReport, is_planned: bool) -> None:
        """Note a time with the report of its solve, if this says that nothing is admissible."""
        if not report.is_infeasible:
            return
        self._refused.append(demand)
        if is_planned and self._planned is None:
            self._planned = demand.time, report

    def reach(self, demand: Demand) -> None:
        """Note a time at which a solution was found that is admissible."""
        self._reached = demand

    def excludes(self, demand: Demand) -> bool:
        """Whether nothing is admissible then, as the proofs for other times show; collective."""
        reached = self._reached
        return any(
            demand.repeats(refused) or (reached is not None and demand.is_beyond(refused, reached))
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
