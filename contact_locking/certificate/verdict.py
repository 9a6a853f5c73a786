"""The certificate of a solved state: every measured value against its limit or proved bound."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any

from dolfinx import fem

from contact_locking.certificate.balances import equilibrium
from contact_locking.certificate.criteria import Criterion
from contact_locking.certificate.elliptic import Lifting, NotApplicable
from contact_locking.certificate.indicator import ErrorIndicator, cell_field, error_indicator
from contact_locking.certificate.laws import entry_criterion, law_criteria
from contact_locking.certificate.penalty_error import penalty_error
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.theory.bounds import proved_bounds
from contact_locking.theory.constants import constant_supports, constants
from contact_locking.theory.critical_friction import critical_friction
from contact_locking.theory.kappa import Kappa, kappa


@dataclass(frozen=True)
class Certificate:
    """Criteria, proved bounds, constants, resultants and error estimates, for summary.json.

    ``indicator`` is None if the error indicator is not applicable.  ``error_bound`` has the roots
    of the contributions of the cells to the guaranteed bound, and is None without this bound.
    ``reactions`` has the reactions of each boundary part with prescribed displacements.
    ``limit_load`` tells which multiples of the prescribed displacements the body can follow; None
    if nobody asks, or if no prescribed displacement differs from zero.  ``critical_friction`` is
    None if nobody asks.
    """

    criteria: dict[str, Criterion]
    bounds: dict[str, dict[str, Any]]
    constants: dict[str, Any]
    resultants: dict[str, Any]
    reactions: dict[str, list[float]]
    errors: dict[str, Any]
    indicator: ErrorIndicator | None
    error_bound: fem.Function | None
    limit_load: dict[str, Any] | None
    critical_friction: dict[str, Any] | None = None
    warnings: tuple[str, ...] = ()

    @property
    def residual(self) -> float:
        """The relative equilibrium residual."""
        return self.criteria["equilibrium"].value

    @property
    def complaint(self) -> str:
        """The criteria and the bounds that do not hold, in words; empty if all hold."""
        broken = [
            f"the {item.meaning} is {item.value:.1e}, above {item.limit:g}"
            for item in self.criteria.values()
            if not item.holds
        ]
        broken += [
            f"the proved bound of {name.replace('_', ' ')} does not hold: {entry['value']:.3g} "
            f"exceeds {entry['bound']:.3g}"
            for name, entry in self.bounds.items()
            if entry["holds"] is False
        ]
        return "; ".join(broken)

    def summary(self) -> dict[str, Any]:
        """The key ``certificate`` of summary.json."""
        asked = {"limit_load": self.limit_load, "critical_friction": self.critical_friction}
        return {
            "criteria": {name: item.summary() for name, item in self.criteria.items()},
            "bounds": self.bounds,
            "constants": self.constants,
            "resultants": self.resultants,
            "errors": self.errors,
            **{name: entry for name, entry in asked.items() if entry is not None},
        }


def is_solved(state: SolvedState) -> bool:
    """Whether equilibrium and the laws hold as in a solution; collective."""
    found = equilibrium(state).criteria(state.settings.tolerance) | law_criteria(state)
    return all(item.holds for item in found.values())


@dataclass(frozen=True)
class Extras:
    """The parts of a certificate that are made on demand.

    These are constants of the theory, a guaranteed error bound, and the critical friction.
    """

    constants: bool = False
    error_bound: bool = False
    critical_friction: bool = False


def certify(state: SolvedState, extras: Extras = Extras()) -> Certificate:
    """Judge a solved state; collective.

    Takes one solve with the inner product of V and, for a finite n, one elastic solve; the
    guaranteed bound takes one to ten solves more, with about six times the unknowns.
    """
    balance = equilibrium(state)
    mesh, indicator = _mesh_error(state)
    lifting, wanted = Lifting(state), extras.error_bound
    small = _kappa(state, extras.constants or wanted)
    with contextlib.closing(lifting):
        bounds = proved_bounds(state, lifting)
        shares: fem.Function | None = None
        limit: dict[str, Any] | None = None
        errors = {"mesh": mesh, "penalty": penalty_error(state, lifting)}
        if wanted:
            # With the parts of SciPy that they use, these proofs take a while to import.
            from contact_locking.theory.guaranteed import (
                guaranteed_error,
                limit_load,
                moving_error,
            )

            limit = limit_load(state)
            errors["guaranteed"], frozen = guaranteed_error(state, lifting)
            if frozen is not None:
                shares = cell_field(state, "error_bound", frozen.squares)
            if any(not contact.friction.frictionless for contact in state.problem.contacts):
                errors["moving_friction"] = moving_error(state, frozen, small)
    return Certificate(
        criteria=balance.criteria(state.settings.tolerance)
        | law_criteria(state)
        | entry_criterion(state),
        bounds=bounds,
        constants=constants(state, extras.constants, small),
        resultants={
            "loads": balance.loads.tolist(),
            "contact": balance.contact.tolist(),
            "reactions": balance.reactions.tolist(),
        },
        reactions={name: list(map(float, x)) for name, x in balance.reactions_by_part.items()},
        errors=errors,
        indicator=indicator,
        error_bound=shares,
        limit_load=limit,
        critical_friction=critical_friction(state) if extras.critical_friction else None,
        warnings=constant_supports(state) if extras.constants or wanted else (),
    )


def _kappa(state: SolvedState, wanted: bool) -> Kappa | NotApplicable:
    """Kappa, or why there is none; collective."""
    try:
        return kappa(state, wanted)
    except NotApplicable as failure:
        return failure


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
