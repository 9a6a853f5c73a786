"""A wing: derivatives of solutions, and fits of numbers to measurements."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contact_locking import wings

if TYPE_CHECKING:
    from contact_locking.running.assembly import StudyProblem


def _derives(problem: StudyProblem, *_: Any) -> bool:
    return problem.parameters.sensitivities is not None


def _asks(problem: StudyProblem) -> bool:
    return _derives(problem) or problem.parameters.fit is not None


wings.DERIVATIVES.add(f"{__name__}.sensitivities:LazyDerivatives")
wings.CHECKS.add(f"{__name__}.sensitivities:require_known", _asks)
wings.FOLLOWERS.add(f"{__name__}.sensitivities:Sensitivities", _derives)
wings.TABLES.add(f"{__name__}.sensitivities:in_rows")
