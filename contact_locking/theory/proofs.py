"""What the theory proves about a solved state: bounds, constants, uniqueness, a limit load."""

from __future__ import annotations

from typing import Any

from contact_locking.certificate.elliptic import Lifting, NotApplicable
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.certificate.verdict import Extras, Proofs
from contact_locking.fields import plausibility
from contact_locking.theory.bounds import proved_bounds
from contact_locking.theory.constants import constant_supports, constants
from contact_locking.theory.critical_friction import critical_friction
from contact_locking.theory.kappa import Kappa, kappa
from contact_locking.theory.other_solutions import share_against_sliding


def proofs(state: SolvedState, lifting: Lifting, extras: Extras) -> Proofs:
    """The a priori bounds, constants, and the parts that ``extras`` asks for; collective."""
    small = _kappa(state, extras.constants)
    bounds = proved_bounds(state, lifting)
    entries: dict[str, Any] = {"bounds": bounds}
    errors: dict[str, Any] = {}
    reason = ""
    if extras.error_bound:
        # With the parts of SciPy that they use, these proofs take a while to import.
        from contact_locking.theory.guaranteed import guaranteed_error, limit_load

        limit = limit_load(state)
        entries |= {} if limit is None else {"limit_load": limit}
        if limit is not None and limit["infeasible"]:
            most = f"{100.0 * limit['load_factor'][1]:.3g}"
            reason = f"on no mesh can more than {most} % of them be followed"
        errors["guaranteed"] = guaranteed_error(state, lifting)
    entries["constants"] = constants(state, extras.constants, small)
    if extras.critical_friction:
        entries["critical_friction"] = critical_friction(state)
    broken = [
        f"the proved bound of {name.replace('_', ' ')} does not hold: {entry['value']:.3g} "
        f"exceeds {entry['bound']:.3g}"
        for name, entry in bounds.items()
        if entry["holds"] is False
    ]
    warnings = constant_supports(state) if extras.constants else ()
    return Proofs(entries, errors, "; ".join(broken), reason, (*_about_friction(state), *warnings))


def _kappa(state: SolvedState, wanted: bool) -> Kappa | NotApplicable:
    """Kappa, or why there is none; collective."""
    try:
        return kappa(state, wanted)
    except NotApplicable as failure:
        return failure


def _about_friction(state: SolvedState) -> list[str]:
    """A warning where friction alone holds the body and much of it is needed; collective."""
    contacts = state.problem.data.contacts
    slides = any(contact.friction.depends_on_slip for contact in contacts)
    if not state.report.converged or not state.problem.sliding or slides:
        return []
    return plausibility.about_the_friction_used(share_against_sliding(state))
