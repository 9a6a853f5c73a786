"""A wing: what can be proved about a solution, and about how many there are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from contact_locking import wings

if TYPE_CHECKING:
    from contact_locking.certificate.elliptic import Lifting
    from contact_locking.certificate.solved_state import SolvedState
    from contact_locking.certificate.verdict import Extras, Proofs
    from contact_locking.process.solving import Follower, SolvableStudy
    from contact_locking.solver.strategy import Rescue
    from contact_locking.solver.task import SolverReport, Task


# Modules are imported where they are used: most runs use few of them.
@wings.PROOFS.add
def _proofs(state: SolvedState, lifting: Lifting, extras: Extras) -> Proofs:
    from contact_locking.theory.bounds import proofs

    return proofs(state, lifting, extras)


@wings.RESCUES.add
def _rescue(task: Task, report: SolverReport, most_tangents: int) -> Rescue:
    from contact_locking.theory.equilibria.stiffening import rescue

    return rescue(task, report, most_tangents)


@wings.FOLLOWERS.add
def _solutions(study: SolvableStudy) -> Follower | None:
    if study.parameters.branches is None and study.parameters.equilibria is None:
        return None
    from contact_locking.theory.solutions import SectionsOfStudy

    return SectionsOfStudy(study)


@wings.WORDS.add
def _words(summary: Mapping[str, Any]) -> list[tuple[str, str | None]]:
    from contact_locking.theory.words import rows

    return rows(summary)


@wings.TABLES.add
def _table(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    from contact_locking.theory.words import equilibria

    return equilibria(summary)
