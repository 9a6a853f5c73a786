"""A wing: derivatives of solutions, and fits of numbers to measurements."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from contact_locking import wings

if TYPE_CHECKING:
    from contact_locking.process.problem_solver import ProblemSolver
    from contact_locking.process.solving import Follower, SolvableStudy
    from contact_locking.results.solution import Differentiable
    from contact_locking.solver.task import SolverReport
    from contact_locking.study.assembly import StudyProblem


# Modules are imported where they are used: most runs use none of them.
@wings.DERIVATIVES.add
def _derivatives(solver: ProblemSolver, report: SolverReport) -> Differentiable:
    from contact_locking.inverse.sensitivities import LazyDerivatives

    return LazyDerivatives(solver, report)


@wings.CHECKS.add
def _check(problem: StudyProblem) -> None:
    if problem.parameters.sensitivities is not None or problem.parameters.fit is not None:
        from contact_locking.inverse.sensitivities import require_known

        require_known(problem)


@wings.FOLLOWERS.add
def _sensitivities(study: SolvableStudy) -> Follower | None:
    if study.parameters.sensitivities is None:
        return None
    from contact_locking.inverse.sensitivities import Sensitivities

    return Sensitivities(study)


@wings.TABLES.add
def _table(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    from contact_locking.inverse.sensitivities import in_rows

    return in_rows(summary)
