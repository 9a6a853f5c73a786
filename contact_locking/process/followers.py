"""What a study asks for beside its solutions, as wings make it."""

from __future__ import annotations

from typing import Protocol

from contact_locking import wings
from contact_locking.monitor import Monitor
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.results.solution import StudySolution
from contact_locking.solver.task import SolverReport
from contact_locking.study.assembly import StudyProblem

# The wings of sections of the study file, and of parts of its certificate.
_SECTIONS = {"sensitivities": "inverse", "branches": "theory", "equilibria": "theory"}
_PARTS = ("constants", "error_bound", "critical_friction")


class Follower(Protocol):
    """What a study asks for beside each of its solutions; collective."""

    def after(
        self, solution: StudySolution, report: SolverReport, time: float | None
    ) -> StudySolution:
        """The solution with what is added to it; ``time`` is the end of a step."""

    def close(self) -> None:
        """Destroy the PETSc objects."""


def followers_of(problem: StudyProblem, solver: ProblemSolver, monitor: Monitor) -> list[Follower]:
    """Made before the first solve; collective.

    Raises InputError for what cannot be followed, or takes a wing that is not installed.
    """
    parameters = problem.parameters
    for name, wing in _SECTIONS.items():
        if getattr(parameters, name) is not None:
            wings.require(wing, name)
    for name in _PARTS:
        if getattr(parameters.certificate, name):
            wings.require("theory", f"certificate.{name}")
    made = (follow(problem, solver, monitor) for follow in wings.FOLLOWERS)
    return [follower for follower in made if follower is not None]
