"""The certificate of a solved state: every measured value against its limit or proved bound."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from contact_locking import wings
from contact_locking.certificate.balances import equilibrium
from contact_locking.certificate.indicator import ErrorIndicator, error_indicator
from contact_locking.certificate.laws import entry_criterion, law_criteria
from contact_locking.certificate.penalty_error import Lifting, NotApplicable, penalty_error
from contact_locking.certificate.solved_state import Criterion, SolvedState
from contact_locking.findings import Finding
from contact_locking.results.output import Extras


@dataclass(frozen=True)
class Proofs:
    """What is proved about a solved state.

    ``entries`` are further keys of the certificate in summary.json, and ``errors`` further error
    estimates.  ``complaint`` says in words what contradicts the solution, ``reason`` why a solve
    that has failed cannot arrive, and ``warnings`` what to mind.
    """

    entries: Mapping[str, Any] = field(default_factory=dict)
    errors: Mapping[str, Any] = field(default_factory=dict)
    complaint: str = ""
    reason: str = ""
    warnings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class Certificate:
    """Criteria, resultants, error estimates and what is proved, for summary.json.

    ``indicator`` is None if the error indicator is not applicable.  ``reactions`` has the reactions
    of each boundary part with prescribed displacements.
    """

    criteria: dict[str, Criterion]
    resultants: dict[str, Any]
    reactions: dict[str, list[float]]
    errors: dict[str, Any]
    indicator: ErrorIndicator | None
    proofs: Proofs

    @property
    def residual(self) -> float:
        """The relative equilibrium residual."""
        return self.criteria["equilibrium"].value

    @property
    def complaint(self) -> str:
        """The criteria and the proofs that do not hold, in words; empty if all hold."""
        broken = [
            f"the {criterion.meaning} is {criterion.value:.1e}, above {criterion.limit:g}"
            for criterion in self.criteria.values()
            if not criterion.holds
        ]
        return "; ".join(filter(None, (*broken, self.proofs.complaint)))

    def summary(self) -> dict[str, Any]:
        """The entries of summary.json about the certificate."""
        bounds = self.proofs.entries.get("bounds")
        return {
            **({} if bounds is None else {"bounds": bounds}),
            "reactions": self.reactions,
            "residual": self.residual,
            "certificate": {
                "criteria": {
                    name: criterion.summary() for name, criterion in self.criteria.items()
                },
                **self.proofs.entries,
                "resultants": self.resultants,
                "errors": {**self.errors, **self.proofs.errors},
            },
        }


def is_solved(state: SolvedState) -> bool:
    """Whether equilibrium and the laws hold as in a solution; collective."""
    criteria = equilibrium(state).criteria(state.settings.tolerance) | law_criteria(state)
    return all(criterion.holds for criterion in criteria.values())


def certify(
    state: SolvedState, extras: Extras, criteria: Mapping[str, Criterion] | None = None
) -> Certificate:
    """Judge a solved state, also by further ``criteria``; collective.

    Takes one solve with the inner product of V and, for a finite n, one elastic solve; the
    guaranteed bound takes one to ten solves more, with about six times the unknowns.
    """
    balance, names = equilibrium(state), ("loads", "contact", "reactions")
    mesh, indicator = _mesh_error(state)
    with contextlib.closing(Lifting(state)) as lifting:
        penalty = penalty_error(state, lifting)
        proofs = next((prove(state, lifting, extras) for prove in wings.PROOFS), Proofs())
    return Certificate(
        criteria=balance.criteria(state.settings.tolerance)
        | law_criteria(state)
        | entry_criterion(state)
        | dict(criteria or {}),
        resultants={name: getattr(balance, name).tolist() for name in names},
        reactions={name: list(map(float, x)) for name, x in balance.reactions_by_part.items()},
        errors={"mesh": mesh, "penalty": penalty},
        indicator=indicator,
        proofs=proofs,
    )


def _mesh_error(state: SolvedState) -> tuple[dict[str, Any], ErrorIndicator | None]:
    """The entry ``mesh`` of the error estimates, and the indicator; collective.

    Without an indicator the entry has the reason.
    """
    try:
        indicator = error_indicator(state)
    except NotApplicable as failure:
        none = dict.fromkeys(("energy_norm", "relative", "with_locking"))
        return {**none, "reason": str(failure)}, None
    return {
        "energy_norm": indicator.elastic,
        "relative": state.relative(indicator.elastic),
        "with_locking": indicator.total,
    }, indicator
