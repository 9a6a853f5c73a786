"""Criteria that stress, pressures and tractions obey the laws of locking, contact and friction.

This module repeats the laws on purpose, in NumPy and by their conjugate functions, so that errors
in the laws of the solver show here.  For a fixed friction bound each law is ``z in d phi(x)``, and
Fenchel's sum ``phi(x) + phi*(z) - z x >= 0`` is zero exactly if the law holds.  In equilibrium the
sum over all laws is the duality gap.
"""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.certificate.solved_state import Criterion, SolvedState
from contact_locking.contact.coulomb import FrictionBound, Identity
from contact_locking.contact.nodal_contact import joint_norm
from contact_locking.parallel import maximum
from contact_locking.results.contact_points import OPEN
from contact_locking.results.derived import ContactFields

# The interior point method stops at a duality gap of this tolerance.  With the margin the criteria
# accept its solutions, with errors up to 1.4e-7 of the elastic energy, and refuse a lost factor or
# sign, with 1e-5 and more for n up to 1e4.  A larger tolerance of the solver raises the limit.
_TOLERANCE = 1e-8
_MARGIN = 100.0
# R is one product or one direct solve, with a rounding of 1e-14.
_CONSTANTS = 1e-10
#: The criterion about foundations that enter between the nodes.
ENTRY = "penetration_between_nodes"
# The largest depth of a foundation between the nodes over its indentation.
_ENTRY = 0.5
# The largest share of tractions at open nodes, which the tolerances permit.
_OPEN = 1e-4
# The largest distance of touching bodies over their relative displacement.
_APART = 0.3
# The largest area of a pressing node over the part of it that the other body covers.
_SLIVER = 30.0


def law_limit(state: SolvedState) -> float:
    """The limit of errors relative to the work: the tolerance of the solver with a margin."""
    return _MARGIN * max(state.settings.tolerance, _TOLERANCE)


def law_criteria(state: SolvedState) -> dict[str, Criterion]:
    """The criteria of all laws, relative to the work of the state; collective.

    The limits are the tolerances of the solver with a margin.
    """
    law = law_limit(state)

    def of_law(value: float, meaning: str) -> Criterion:
        return Criterion(float(value), law, meaning)

    products, violation, squares = locking(state)
    gap = products + squares
    criteria = {
        "locking_complementarity": of_law(products, "complementarity of locking"),
        "locking_violation": of_law(violation, "violation of the locking law"),
    }
    if state.contacts:
        products, violation, conjugate = np.sum([contact(state, c) for c in state.contacts], axis=0)
        gap += conjugate
        held = "share of the contact forces at nodes that conditions hold"
        criteria |= {
            "contact_complementarity": of_law(products, "complementarity of contact"),
            "contact_violation": of_law(violation, "violation of the contact law"),
            "held_nodes": of_law(held_nodes(state), held),
        }
    rubbing = [fields for fields in state.contacts if not fields.contact.friction.frictionless]
    if rubbing:
        slid, cones, signs = np.transpose([friction(state, fields) for fields in rubbing])
        gap += sum(slid)
        settled = _MARGIN * max(state.settings.friction_tolerance, _TOLERANCE)
        change = bound_change(state, rubbing)
        moved = "distance of the friction bound from mu |R sigma_nu|"
        constants = max(smoothing_constants(state, fields) for fields in rubbing)
        criteria |= {
            "friction_complementarity": of_law(sum(slid), "complementarity of friction"),
            "coulomb_cone": of_law(max(cones), "friction above its bound"),
            "friction_sign": of_law(sum(signs), "work that friction adds"),
            "friction_bound": Criterion(change, settled, moved),
            "smoothing_constants": Criterion(constants, _CONSTANTS, "change of constants by R"),
        }
    local = [fields for fields in rubbing if _is_local(fields.contact.friction)]
    if local:
        share = "share of the tractions at open nodes in the contact forces"
        criteria["open_traction"] = Criterion(open_traction(state, local), _OPEN, share)
    return criteria | {"duality_gap": of_law(gap, "duality gap")}


def entry_criterion(state: SolvedState) -> dict[str, Criterion]:
    """Whether foundations also stay out of the body between the nodes of Gamma_C; collective.

    The conditions of contact hold at the nodes only, and a foundation that is narrower than a facet
    may enter between them to any depth.
    """
    if not state.contacts:
        return {}
    share = max(fields.entry.missed for fields in state.contacts)
    depth = "depth of a foundation that the nodes miss, as a share of its indentation,"
    criteria = {ENTRY: Criterion(share, _ENTRY, depth)}
    bodies = [fields for fields in state.contacts if fields.surface.frame is not None]
    if bodies:
        distance = max(fields.apart for fields in bodies)
        sliver = max(_sliver(fields) for fields in bodies)
        criteria |= {
            "bodies_apart": Criterion(
                distance, _APART, "distance of bodies where they press, or entry elsewhere,"
            ),
            "pressure_on_slivers": Criterion(
                sliver, _SLIVER, "area of a node that presses, over the part that is covered,"
            ),
        }
    return criteria


def _sliver(fields: ContactFields) -> float:
    """The largest quotient of the areas of a node that presses and of its covered part."""
    frame = fields.surface.frame
    assert frame is not None
    covered: FloatArray = frame.covered[fields.pressure > 0.0]
    return maximum(fields.surface.domain.comm, np.asarray(1.0 / covered, dtype=float))


def _is_local(friction: FrictionBound) -> bool:
    """Whether the friction bound is zero at open nodes: Coulomb's, and R does not smooth it."""
    return friction.is_coulomb and isinstance(friction.smoothing, Identity)


def open_traction(state: SolvedState, local: list[ContactFields]) -> float:
    """``int |t|`` over the open nodes of ``local`` friction, over ``int p``; collective."""
    at_open = sum(
        state.sum(
            np.where(fields.state == OPEN, state.weights(fields), 0.0)
            * np.linalg.norm(fields.traction, axis=1)
        )
        for fields in local
    )
    total = sum(
        state.sum(state.weights(fields) * np.maximum(fields.pressure, 0.0))
        for fields in state.contacts
    )
    return at_open / total if total > 0.0 else 0.0


def locking(state: SolvedState) -> tuple[float, float, float]:
    """Complementarity, violation and squares of the locking law, relative to the work; collective.

    Complementarity is ``int |Z| max(M, |eps|) - Z : eps``, and violation is
    ``s int |[|eps| - M]^+ - |Z|/(2n)|``.  Where both vanish, ``Z`` is ``R_n(eps)`` (23), or for
    n = inf an element of ``dI_B(eps)`` (1).  The stress s is the mean stress or, if this is less,
    ``2n`` times the mean strain.  Squares is ``n int ([|eps| - M]^+ - |Z|/(2n))^2``, 0 for n = inf.

    With several sets of strains each has such terms, with ``L eps`` and its multiplier y in the
    place of eps and Z, and the terms are added.  The violation of a half space includes
    ``|eps| int [-y]^+`` with the mean strain.  Where all terms vanish, Z is in the normal cone of K
    for n = inf.
    """
    points, n = state.points, state.target.penalty.n
    stress = min(state.mean_stress, 2.0 * n * state.mean_strain)
    products = violation = squares = 0.0
    for law in points.sets:
        measured = law.measured(state.problem.u)
        defect = np.abs(law.excess(measured) - law.size / (2.0 * n))
        products += state.sum(points.weights * np.abs(law.most_work(measured) - law.work(measured)))
        violation += stress * state.sum(points.weights * defect)
        violation += state.mean_strain * state.sum(points.weights * law.pulling)
        squares += n * state.sum(points.weights * defect**2) if np.isfinite(n) else 0.0
    return (
        state.share_of_work(products),
        state.share_of_work(violation),
        state.share_of_work(squares),
    )


def contact(state: SolvedState, fields: ContactFields) -> tuple[float, float, float]:
    """Complementarity, violation and Fenchel's sum of contact, relative to the work; collective.

    Complementarity is ``int |p c|`` and violation is ``s int [-c]^+ + |eps| L int [-p]^+`` with the
    opening ``c = gap + eps p - u_nu``.  Where both vanish, ``p = [u_nu - gap]^+/eps`` (25) or, for
    eps = 0, Signorini's conditions (5) hold.  The stress s is the mean stress or, if this is less,
    ``|eps| L/eps``.  Fenchel's sum is ``int |p (max(gap, u_nu) - u_nu)|`` plus, for eps > 0,
    ``int ([u_nu - gap]^+ - eps p)^2/(2 eps)``.
    """
    weights = state.weights(fields)
    opening = fields.gap + state.target.penalty.epsilon * fields.pressure - fields.u_normal
    length, epsilon = state.target.length * state.mean_strain, state.target.penalty.epsilon
    stress = state.mean_stress if epsilon == 0.0 else min(state.mean_stress, length / epsilon)
    entering = state.sum(weights * np.maximum(-opening, 0.0))
    pulling = state.sum(weights * np.maximum(-fields.pressure, 0.0))
    apart = np.maximum(fields.gap - fields.u_normal, 0.0)
    conjugate = np.abs(fields.pressure * apart)
    if epsilon > 0.0:
        defect = np.maximum(fields.u_normal - fields.gap, 0.0) - epsilon * fields.pressure
        conjugate += defect**2 / (2.0 * epsilon)
    return (
        state.share_of_work(state.sum(weights * np.abs(fields.pressure * opening))),
        state.share_of_work(stress * entering + length * pulling),
        state.share_of_work(state.sum(weights * conjugate)),
    )


def friction(state: SolvedState, fields: ContactFields) -> tuple[float, float, float]:
    """Complementarity, excess over the bound, and wrong sign of friction, all relative; collective.

    With ``t = -sigma_tau``, the slip ``s = u_tau - u_{k-1,tau}`` of the step and the friction bound
    G, complementarity is ``int G sqrt(|s|^2 + eps^2) - eps sqrt(G^2 - |t|^2) - t . s`` over the
    work, zero exactly where (22) holds.  The excess is ``int [|t| - G]^+`` over ``int G``.  The
    wrong sign is ``int [-t . s]^+`` over the work: friction dissipates work and never adds work.
    """
    epsilon = fields.regularisation
    weights = state.weights(fields)
    size = np.linalg.norm(fields.traction, axis=1)
    slip = np.sqrt(np.sum(fields.increment**2, axis=1) + epsilon**2)
    work = -np.sum(fields.traction * fields.increment, axis=1)
    regularised = epsilon * np.sqrt(np.maximum(fields.bound**2 - size**2, 0.0))
    products = np.abs(fields.bound * slip - regularised - work)
    # A friction bound that is smaller on average counts as zero.
    area = state.sum(fields.surface.weights)
    least = state.target.least_bound(state.mean_strain) * float(np.sqrt(area))
    most = max(state.sum(weights * fields.bound), least)
    outside = state.sum(weights * np.maximum(size - fields.bound, 0.0))
    return (
        state.share_of_work(state.sum(weights * products)),
        outside / most if most > 0.0 else outside,
        state.share_of_work(state.sum(weights * np.maximum(-work, 0.0))),
    )


def bound_change(state: SolvedState, rubbing: list[ContactFields]) -> float:
    """The largest ``|G - mu(s) |R sigma_nu||/|mu |R sigma_nu||``, with the bound G of the solver.

    Both are norms in L2: above on one contact, below over all contacts.  Rounding on a contact
    that does not press counts little beside the friction elsewhere.  Collective.
    """
    contacts, u = [fields.contact for fields in rubbing], state.problem.u
    bounds = [fields.contact.friction_bound(u, fields.pressure) for fields in rubbing]
    size = max(joint_norm(contacts, bounds), state.target.least_bound(state.mean_strain))
    change = max(
        fields.contact.norm(np.where(state.held(fields), 0.0, fields.bound - values))
        for fields, values in zip(rubbing, bounds, strict=True)
    )
    return change / size if size > 0.0 else change


def held_nodes(state: SolvedState) -> float:
    """``int |p| + |sigma_tau|`` over the held nodes, relative to that over all nodes; collective.

    At these nodes displacements are prescribed, and neither pressure nor friction acts.
    """
    carried = whole = 0.0
    for fields in state.contacts:
        sizes = np.abs(fields.pressure) + np.linalg.norm(fields.traction, axis=1)
        forces = fields.surface.weights * sizes
        carried += state.sum(forces[state.held(fields)])
        whole += state.sum(forces)
    return carried / whole if whole > 0.0 else 0.0


def smoothing_constants(state: SolvedState, fields: ContactFields) -> float:
    """``max |R 1 - 1|`` over the free nodes, at which R must preserve constants; collective."""
    contact, free = fields.contact, ~state.held(fields)
    smoothing = contact.friction.smoothing
    change = (smoothing.apply(np.ones(len(free))) - 1.0)[free]
    change = np.abs(change) if smoothing.keeps_constants else np.maximum(change, 0.0)
    return maximum(contact.surface.domain.comm, change)
