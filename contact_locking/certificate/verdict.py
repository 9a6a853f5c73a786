"""The certificate of a solved state: everything measured against what is proved."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any

from dolfinx import fem

from contact_locking.certificate.balances import equilibrium
from contact_locking.certificate.bounds import proved_bounds
from contact_locking.certificate.constants import constants
from contact_locking.certificate.criteria import Criterion, complaints
from contact_locking.certificate.elliptic import NotApplicable
from contact_locking.certificate.indicator import error_indicator
from contact_locking.certificate.laws import law_criteria
from contact_locking.certificate.lifting import Lifting
from contact_locking.certificate.penalty_error import penalty_error
from contact_locking.certificate.solved_state import SolvedState


@dataclass(frozen=True)
class Certificate:
    """Criteria that hold or not, proved bounds, constants, resultants and error estimates.

    ``error_indicator`` is the field of the indicator, None where it is not applicable; the rest
    goes into summary.json.
    """

    criteria: dict[str, Criterion]
    bounds: dict[str, dict[str, Any]]
    constants: dict[str, Any]
    resultants: dict[str, Any]
    errors: dict[str, Any]
    error_indicator: fem.Function | None

    @property
    def residual(self) -> float:
        """The relative equilibrium residual."""
        return self.criteria["equilibrium"].value

    @property
    def complaint(self) -> str:
        """Which criteria and bounds fail, in words; nothing if all hold."""
        broken = [
            f"the proved bound of {name.replace('_', ' ')} does not hold: {entry['value']:.3g} "
            f"exceeds {entry['bound']:.3g}"
            for name, entry in self.bounds.items()
            if entry["holds"] is False
        ]
        return "; ".join(filter(None, [complaints(self.criteria), *broken]))

    def summary(self) -> dict[str, Any]:
        """What summary.json says under ``certificate``."""
        return {
            "criteria": {name: item.summary() for name, item in self.criteria.items()},
            "bounds": self.bounds,
            "constants": self.constants,
            "resultants": self.resultants,
            "errors": self.errors,
        }


def is_solved(state: SolvedState, sharply: bool) -> bool:
    """Whether equilibrium and the laws hold as in a solution; collective.

    ``sharply``: to the tolerances where a solver stops, without the certificate's margin.
    """
    laws = law_criteria(state, 1.0) if sharply else law_criteria(state)
    found = equilibrium(state).criteria(state.settings.tolerance) | laws
    return all(item.holds for item in found.values())


def certify(state: SolvedState) -> Certificate:
    """Judge a solved state; collective.

    Costs one solve with the inner product of V and, for a finite n, one elastic solve.
    """
    balance = equilibrium(state)
    mesh, field = _mesh_error(state)
    lifting = Lifting(state)
    with contextlib.closing(lifting):
        bounds = proved_bounds(state, lifting)
        penalty = penalty_error(state, lifting)
    return Certificate(
        criteria=balance.criteria(state.settings.tolerance) | law_criteria(state),
        bounds=bounds,
        constants=constants(state),
        resultants={
            "loads": balance.loads.tolist(),
            "contact": balance.contact.tolist(),
            "reactions": balance.reactions.tolist(),
        },
        errors={"mesh": mesh, "penalty": penalty},
        error_indicator=field,
    )


def _mesh_error(state: SolvedState) -> tuple[dict[str, Any], fem.Function | None]:
    """The indicator of the error in h as numbers, or the reason for none, and as a field."""
    try:
        indicator = error_indicator(state)
    except NotApplicable as failure:
        none = dict.fromkeys(("energy_norm", "relative", "with_locking"))
        return {**none, "reason": str(failure)}, None
    size = (2.0 * state.energy) ** 0.5
    return {
        "energy_norm": indicator.elastic,
        "relative": indicator.elastic / size if size > 0.0 else None,
        "with_locking": indicator.total,
    }, indicator.field
