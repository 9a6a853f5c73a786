"""Whether the stored stress and tractions obey the laws of locking, contact and friction.

The formulas stand here a second time, in NumPy and from the conjugate functions, on purpose: what
the solver's laws get wrong is not repeated.  For a frozen friction bound each law is
``z in d phi(x)``, so Fenchel's ``phi(x) + phi*(z) - z x >= 0`` vanishes exactly where it holds.  It
is a complementarity and, for finite n and eps > 0, ``n int ([|eps| - M]^+ - |Z|/(2n))^2`` and
``int ([u_nu - gap]^+ - eps p)^2/(2 eps)``.  With equilibrium the sum over the laws is the duality
gap, and bounds ``a(u - w, u - w)/2`` for the exact discrete solution ``w`` with this friction
bound, where the displacement violates no limit (n = inf) and no gap (eps = 0).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from contact_locking.certificate.criteria import Criterion
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.results.derived import ContactFields

FloatArray = npt.NDArray[np.float64]

# Measured over all demos, the problems of the tests and some 1000 random ones, 2D and 3D, penalties
# up to 1e10 times the stiffness and inf: work that should vanish is up to 1.4e-7 of the elastic
# energy, where the interior point method stops at its duality gap of 1e-8.  A lost factor or sign
# leaves 1e-5 and more up to n = 1e4.  A solver that was told to be coarser is judged accordingly.
_TOLERANCE = 1e-8
_MARGIN = 100.0
# R is applied once, by a product or a direct solve: rounding leaves 1e-14.
_CONSTANTS = 1e-10


def law_criteria(state: SolvedState, margin: float = _MARGIN) -> dict[str, Criterion]:
    """Complementarity and violation of every law, relative to the work of the state; collective.

    Limits are the solver's tolerances times ``margin``.
    """
    law = margin * max(state.settings.tolerance, _TOLERANCE)
    products, violation, squares = locking(state)
    gap = products + squares
    found = {
        "locking_complementarity": Criterion(products, law, "complementarity of locking"),
        "locking_violation": Criterion(violation, law, "violation of the locking law"),
    }
    if state.contacts:
        products, violation, conjugate = np.sum([contact(state, c) for c in state.contacts], axis=0)
        gap += conjugate
        found["contact_complementarity"] = Criterion(
            float(products), law, "complementarity of contact"
        )
        found["contact_violation"] = Criterion(
            float(violation), law, "violation of the contact law"
        )
    rubbing = [fields for fields in state.contacts if not fields.contact.friction.frictionless]
    if rubbing:
        found |= _friction_criteria(state, rubbing, law, margin)
        gap += found["friction_complementarity"].value
    found["duality_gap"] = Criterion(float(gap), law, "duality gap")
    return found


def _friction_criteria(
    state: SolvedState, rubbing: list[ContactFields], law: float, margin: float
) -> dict[str, Criterion]:
    products, cones, signs = np.transpose([friction(state, fields) for fields in rubbing])
    settled = margin * max(state.settings.friction_tolerance, _TOLERANCE)
    change = max(bound_change(state, fields) for fields in rubbing)
    constants = max(smoothing_constants(fields) for fields in rubbing)
    return {
        "friction_complementarity": Criterion(
            float(sum(products)), law, "complementarity of friction"
        ),
        "coulomb_cone": Criterion(float(max(cones)), law, "friction above its bound"),
        "friction_sign": Criterion(float(sum(signs)), law, "work that friction adds"),
        "friction_bound": Criterion(
            change, settled, "distance of the friction bound from mu |R sigma_nu|"
        ),
        "smoothing_constants": Criterion(constants, _CONSTANTS, "change of constants by R"),
    }


def locking(state: SolvedState) -> tuple[float, float, float]:
    """``int |Z| max(M, |eps|) - Z : eps``, ``s int |[|eps| - M]^+ - |Z|/(2n)|``, and squares.

    The last is ``n int ([|eps| - M]^+ - |Z|/(2n))^2``, 0 for n = inf.  Where the others vanish
    ``Z`` is ``R_n(eps)`` (23), for n = inf an element of ``dI_B(eps)`` (1).  The stress s is the
    mean stress; a soft penalty answers a strain by less, ``2n`` times the mean.
    """
    points = state.points
    norm = np.linalg.norm(points.strain, axis=(1, 2))
    size = np.linalg.norm(points.locking_stress, axis=(1, 2))
    work = np.einsum("kij,kij->k", points.locking_stress, points.strain)
    locks = np.isfinite(points.limit)
    # What cannot lock has no locking stress to be parallel to.
    largest = np.maximum(np.where(locks, points.limit, norm), norm)
    products = np.abs(size * largest - work)
    excess = np.maximum(norm - points.limit, 0.0)
    violation = np.abs(excess - size / (2.0 * state.target.penalty.n))
    n = state.target.penalty.n
    stress = min(state.mean_stress, 2.0 * n * state.mean_strain)
    squares = n * state.sum(points.weights * violation**2) if np.isfinite(n) else 0.0
    return (
        state.share_of_work(state.sum(points.weights * products)),
        state.share_of_work(stress * state.sum(points.weights * violation)),
        state.share_of_work(squares),
    )


def contact(state: SolvedState, fields: ContactFields) -> tuple[float, float, float]:
    """``int |p c|``, ``s int [-c]^+ + |eps| L int [-p]^+``, and Fenchel's sum.

    ``c = gap + eps p - u_nu``, and the sum is ``int |p (max(gap, u_nu) - u_nu)|`` and, for eps > 0,
    ``int ([u_nu - gap]^+ - eps p)^2/(2 eps)``.  Where the others vanish ``p = [u_nu - gap]^+/eps``
    (25), for eps = 0 Signorini's conditions (5).  The stress s is the mean stress, or
    ``|eps| L/eps`` if a soft foundation answers by less.
    """
    weights = fields.surface.weights * fields.contact.free
    opening = fields.gap + state.target.penalty.epsilon * fields.pressure - fields.u_normal
    length, epsilon = state.target.length * state.mean_strain, state.target.penalty.epsilon
    stress = state.mean_stress if epsilon == 0.0 else min(state.mean_stress, length / epsilon)
    entering = state.sum(weights * np.maximum(-opening, 0.0))
    pulling = state.sum(weights * np.maximum(-fields.pressure, 0.0))
    apart = np.maximum(fields.gap - fields.u_normal, 0.0)
    conjugate = np.abs(fields.pressure * apart)
    if epsilon > 0.0:
        left = np.maximum(fields.u_normal - fields.gap, 0.0) - epsilon * fields.pressure
        conjugate += left**2 / (2.0 * epsilon)
    return (
        state.share_of_work(state.sum(weights * np.abs(fields.pressure * opening))),
        state.share_of_work(stress * entering + length * pulling),
        state.share_of_work(state.sum(weights * conjugate)),
    )


def friction(state: SolvedState, fields: ContactFields) -> tuple[float, float, float]:
    """Complementarity, the cone, and the sign, with ``t = -sigma_tau``, ``s = u_tau``, ``G``.

    ``int G sqrt(|s|^2 + eps^2) - eps sqrt(G^2 - |t|^2) - t . s`` over the work, zero exactly where
    (22) holds; ``int [|t| - G]^+`` over ``int G``; ``int [-t . s]^+`` over the work: friction takes
    work, it never gives any.
    """
    epsilon = float(fields.contact.regularisation.value)
    weights = fields.surface.weights * fields.contact.free
    size = np.linalg.norm(fields.traction, axis=1)
    slip = np.sqrt(np.sum(fields.u_tangent**2, axis=1) + epsilon**2)
    work = -np.sum(fields.traction * fields.u_tangent, axis=1)
    left = epsilon * np.sqrt(np.maximum(fields.bound**2 - size**2, 0.0))
    products = np.abs(fields.bound * slip - left - work)
    total = state.sum(weights * fields.bound)
    least = _least_bound(state, fields)
    outside = state.sum(weights * np.maximum(size - fields.bound, 0.0))
    return (
        state.share_of_work(state.sum(weights * products)),
        outside / max(total, least) if max(total, least) > 0.0 else outside,
        state.share_of_work(state.sum(weights * np.maximum(-work, 0.0))),
    )


def bound_change(state: SolvedState, fields: ContactFields) -> float:
    """``|G - mu(|u_tau|) |R sigma_nu||/|G|`` in L2 with the bound G that friction obeys."""
    contact = fields.contact
    wanted = contact.friction_bound(state.problem.u, fields.pressure)
    size = max(contact.norm(wanted), state.target.least_bound(state.energy, state.dim))
    change = contact.norm(np.where(contact.free, fields.bound - wanted, 0.0))
    return change / size if size > 0.0 else change


def smoothing_constants(fields: ContactFields) -> float:
    """``max |R 1 - 1|`` over the free nodes: a mollifier keeps constants; collective."""
    contact = fields.contact
    ones = np.ones(len(contact.free))
    change = np.abs(contact.friction.smoothing.apply(ones) - 1.0)[contact.free]
    local = float(np.max(change, initial=0.0))
    return float(max(contact.surface.domain.comm.allgather(local)))


def _least_bound(state: SolvedState, fields: ContactFields) -> float:
    """The integral of a bound below which its share says nothing."""
    area = state.sum(fields.surface.weights)
    return state.target.least_bound(state.energy, state.dim) * float(np.sqrt(area))
