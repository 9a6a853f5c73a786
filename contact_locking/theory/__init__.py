"""A wing: what can be proved about a solution, and about how many there are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contact_locking import wings

if TYPE_CHECKING:
    from contact_locking.running.assembly import StudyProblem


def _asks(problem: StudyProblem, *_: Any) -> bool:
    return problem.parameters.branches is not None or problem.parameters.equilibria is not None


wings.PROOFS.add(f"{__name__}.bounds:proofs")
wings.FOLLOWERS.add(f"{__name__}.solutions:SectionsOfStudy", _asks)
wings.WORDS.add(f"{__name__}.words:rows")
wings.TABLES.add(f"{__name__}.words:equilibria")
