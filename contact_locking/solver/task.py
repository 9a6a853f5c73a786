"""What a strategy works on: a problem, how to solve it, who listens, and the report."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

from contact_locking.laws.penalty import Penalty
from contact_locking.monitor import Monitor
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.settings import Settings
from contact_locking.solver.solver_report import SolverReport
from contact_locking.solver.target import Target


@dataclass(frozen=True)
class Task:
    """The system that holds the displacement, the target to solve it for, and how to do that.

    ``report`` counts what the strategies do, and tells how the solve went in the end.
    """

    system: PenalisedSystem
    target: Target
    settings: Settings = field(default_factory=Settings)
    monitor: Monitor = field(default_factory=Monitor)
    report: SolverReport = field(default_factory=SolverReport)

    def with_settings(self, **changes: Any) -> Task:
        """The same task with other settings."""
        settings = dataclasses.replace(self.settings, **changes)
        return dataclasses.replace(self, settings=settings)

    def aside(self, report: SolverReport, target: Target | None = None) -> Task:
        """A silent task for the same system with a report of its own, for an auxiliary problem."""
        return dataclasses.replace(
            self, target=target or self.target, monitor=Monitor(), report=report
        )

    def least_bound(self) -> float:
        """The norm below which changes of the friction bound are judged absolutely; collective."""
        system, tolerance = self.system, self.settings.tolerance
        displacement = system.largest_displacement()
        strain = self.target.mean_strain(system.energy(), displacement, tolerance)
        return self.target.least_bound(strain)

    def add_stage(self, penalty: Penalty, tangents: int) -> None:
        """Report a stage of the solve that took so many tangents."""
        stage: dict[str, float | int] = {"n": penalty.n, "epsilon": penalty.epsilon}
        self.report.stages.append(stage | {"tangents": tangents})
        self.monitor.counted(self.report.tangents, self.report.friction)

    def succeed(self) -> SolverReport:
        """The report of a solve whose criteria all hold."""
        report = self.report
        report.converged, report.reason, report.suggestion = True, "every criterion held", ""
        return report
