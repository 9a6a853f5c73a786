"""The certificate of a solved state: criteria, balances, error estimates and what is proved."""

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
    """What a wing proves about a solved state.

    - ``entries``: additional keys of the certificate in summary.json
    - ``errors``: additional error estimates
    - ``complaint``: a proof that the solution violates, in words
    - ``reason``: why a failed solve has no solution, in words
    - ``warnings``: findings about the solution
    """

    entries: Mapping[str, Any] = field(default_factory=dict)
    errors: Mapping[str, Any] = field(default_factory=dict)
    complaint: str = ""
    reason: str = ""
    warnings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class Certificate:
    """Criteria, resultants, error estimates and what is proved, for summary.json.

    - ``criteria``: by name, relative values with their limits
    - ``resultants``, ``reactions``: forces on the body, and reactions by boundary part
    - ``errors``, ``indicator``: error estimates, and eta_K by cell (None if not applicable)
    - ``proofs``: what the wing ``theory`` adds
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
        """The criteria and proofs that are violated, in words; empty if there are none."""
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
    """Whether equilibrium and all laws hold; collective."""
    criteria = equilibrium(state).criteria(state.settings.tolerance) | law_criteria(state)
    return all(criterion.holds for criterion in criteria.values())


def certify(
    state: SolvedState, extras: Extras, criteria: Mapping[str, Criterion] | None = None
) -> Certificate:
    """The certificate of a solved state, with additional ``criteria``; collective.

    It takes one solve with the inner product of V and, for a finite n, one elastic solve; the
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
