"""A proved upper bound of the energy norm of the whole error, for the frozen friction bound.

The problem of the bound, its proof and all choices are in docs/notes/bounds.md.  So is the proof
that no displacement of the body follows the prescribed values, on no mesh: no field follows the
multiple f of them for ``f > (int M |s| + int p gap)/int s nu . u_D``, with any stress s in balance
that has the traction ``-p nu``, ``p >= 0``, on Gamma_C.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from dolfinx import fem
from scipy.optimize import minimize_scalar

from contact_locking.arrays import FloatArray
from contact_locking.certificate.penalty_error import (
    Lifting,
    NotApplicable,
    admissible_neighbour,
    energy_distance,
    require_still_foundations,
)
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.parallel import maximum, on_any_rank
from contact_locking.theory.equilibrated_stress import LARGEST_JUMP, Body, Gap, HybridSystem
from contact_locking.theory.stress_data import (
    BalancedLoads,
    ContactTractions,
    balanced_forces,
    balanced_loads,
    contact_tractions,
    held_components,
    require_exact_gaps,
    require_straight_triangles,
)
from contact_locking.theory.triangles import (
    Triangles,
    macro_element,
    product_integral,
)

# The share of M, and of the displacements of the mean strain, by which a solution of the inequality
# may exceed its limits: the tolerance of the solver.
_TOLERANCE = 1e-6
_PROVED = (
    "proved for this friction bound kept fixed, on the polygon of the mesh, with a material that "
    "is constant in each cell; up to rounding and the tolerance of the solver"
)


def guaranteed_error(state: SolvedState, lifting: Lifting) -> dict[str, Any]:
    """``energy_norm``, a bound of ``sqrt(a(u - u_h, u - u_h))``, and ``relative``; collective.

    ``relative`` is the bound over the energy norm of u_h.  ``applicable`` says whether the bound is
    proved, and ``reason`` says of which problem; without a bound, both numbers are None and
    ``reason`` says why.  Takes up to ten linear solves with about six times the unknowns of the
    displacement, one where nothing limits the strain, and for a finite penalty the lift of
    ``penalty_error``.
    """
    try:
        bound = _bound(state, lifting)
    except NotApplicable as failure:
        none = dict.fromkeys(("relative", "energy_norm"))
        return {**none, "applicable": False, "reason": f"not applicable: {failure}"}
    return {
        "relative": state.relative(bound),
        "energy_norm": bound,
        "applicable": True,
        "reason": _PROVED,
    }


def _bound(state: SolvedState, lifting: Lifting) -> float:
    """The bound, by the gaps of cells and of their facets on Gamma_C; collective."""
    _require_applicable(state)
    problem, triangles = state.problem, Triangles(state.problem.domain)
    element = macro_element(problem.element.degree)
    held = held_components(state, triangles)
    loads = balanced_loads(problem.data, triangles, element)
    contacts = [contact_tractions(fields, triangles) for fields in state.contacts]
    require_exact_gaps(state, triangles, contacts)
    forces = balanced_forces(triangles, held, loads, contacts)
    body = Body(state, triangles, element)
    w, apart = _admissible(state, lifting, body, contacts)
    stress = body.balanced(forces, w)
    gap = body.gap(stress, w)
    gaps, nodal = [gap.values], w.x.array.reshape(-1, 2)
    for contact in contacts:
        normal, tangent = contact.split(nodal)
        gaps.append(contact.work(normal, tangent, np.maximum(contact.gap, normal)))
    square = max(state.sum(np.concatenate(gaps)), 0.0)
    return float(np.sqrt(_sharpened(state, gap, square)) + apart)


def _sharpened(state: SolvedState, gap: Gap, square: float) -> float:
    """The least ``2 t eta^2 + sum t (1 - t) a b d^2/(t b - (1 - t) a)`` for t in (1/2, 1].

    For every t this number bounds the square of the energy norm of u - w.  a are the eigenvalues of
    A, b those of A + zeta, and d the differences ``eps(w) - (A + zeta)^-1 s``.  The number is
    ``2 eta^2`` for t = 1, and less for a smaller t where eta^2 consists of the slack of locking and
    contact.  Collective.
    """

    def value(t: float) -> float:
        remainder = 1.0 - t
        bottom = t * gap.stiffened - remainder * gap.elastic
        local = np.sum(gap.apart * gap.elastic * gap.stiffened / bottom)
        return 2.0 * t * square + t * remainder * float(state.comm.allreduce(float(local)))

    minimum = minimize_scalar(value, bounds=(0.5, 1.0), method="bounded", options={"xatol": 1e-3})
    return min(float(minimum.fun), 2.0 * square)


def _require_applicable(state: SolvedState) -> None:
    problem = state.problem
    require_straight_triangles(state)
    if not state.report.converged:
        raise NotApplicable("the solve did not converge")
    require_still_foundations(state)
    if problem.data.own_energy is not None:
        raise NotApplicable("no proof covers a user-defined energy")
    if problem.data.eigenstrain is not None:
        raise NotApplicable("no proof covers an eigenstrain")
    if problem.data.springs:
        raise NotApplicable("no proof covers springs on the boundary")
    memories = [contact.references for contact in problem.contacts]
    if on_any_rank(state.comm, any(bool(np.any(values)) for values in memories)):
        if any(contact.foundation.moves for contact in problem.contacts):
            raise NotApplicable("friction counts the slip on a tool that moves")
        raise NotApplicable("friction counts the slip from an earlier step")
    if not problem.data.only_ball:
        raise NotApplicable("the proof is not for other sets of strains than the ball |eps| <= M")


def _admissible(
    state: SolvedState, lifting: Lifting, body: Body, contacts: list[ContactTractions]
) -> tuple[fem.Function, float]:
    """An admissible field w and ``sqrt(a(w - u_h, w - u_h))``; collective.

    A solution of the inequality may exceed M and the gap by the tolerance of the solver.  The bound
    is then that of the problem with M and the gap enlarged by what w exceeds them.  Raises
    NotApplicable if no admissible field is found.
    """
    w, apart = state.problem.u, 0.0
    if not state.target.penalty.is_inequality or body.excess(w) > _TOLERANCE:
        w = admissible_neighbour(state, lifting)
        apart = energy_distance(state, w)
    if (excess := body.excess(w)) > _TOLERANCE:
        raise NotApplicable(
            f"the strain exceeds the limit by {100.0 * excess:.2g} % between the vertices"
        )
    local = 0.0
    for contact in contacts:
        normal = contact.split(w.x.array.reshape(-1, 2))[0]
        local = max(local, float((normal - contact.gap).max(initial=0.0)))
    if maximum(state.comm, local) > _TOLERANCE * state.mean_strain * state.target.length:
        raise NotApplicable("the displacement enters the foundation between the nodes")
    return w, apart


# Reweighted steps, and the least weight over the largest.
_STEPS, _LEAST = 8, 1e-4
# Rounding in the factor.
_ROUNDING = 1e-8
_LIMIT_PROVED = "proved for every displacement of the polygon of the mesh, up to rounding"


def limit_load(state: SolvedState) -> dict[str, Any] | None:
    """``load_factor`` is [confirmed, excluded], and ``infeasible`` says whether excluded < 1.

    The multiples of the prescribed displacements up to ``confirmed`` have an admissible field in
    the body, that of this mesh, and those above ``excluded`` have none in the body.  The field of
    the mesh is none of the body where it enters the foundation at held nodes of Gamma_C, at which
    the solver asks nothing: ``confirmed`` is then 0.
    ``excluded`` is None if no stress was found that excludes anything.  Returns None where no
    displacement is prescribed that is not zero.  Takes about 8 solves with the
    hybrid system.  Collective.
    """
    if state.problem.constraints.largest() == 0.0:
        return None
    try:
        require_still_foundations(state)
        require_straight_triangles(state)
        if state.problem.element.degree != 1:
            raise NotApplicable("for linear elements")
        triangles = Triangles(state.problem.domain)
        contacts = [contact_tractions(fields, triangles) for fields in state.contacts]
        contacts = [replace(contact, along=np.zeros_like(contact.along)) for contact in contacts]
        require_exact_gaps(state, triangles, contacts)
        excluded = _excluded(state, triangles, contacts)
    except NotApplicable as failure:
        reason = f"not applicable: {failure}"
        return {"infeasible": None, "load_factor": None, "reason": reason}
    confirmed = 0.0
    if state.report.converged and state.target.penalty.is_inequality:
        confirmed = 1.0
    elif state.report.admissible_factor is not None:
        confirmed = state.report.admissible_factor[0]
    nodal = confirmed * state.problem.u.x.array.reshape(-1, 2)
    depths = [(contact.split(nodal)[0] - contact.gap)[contact.fixed] for contact in contacts]
    deepest = max((depth.max(initial=0.0) for depth in depths), default=0.0)
    allowed = _TOLERANCE * state.mean_strain * state.target.length
    if maximum(state.comm, deepest) > allowed:
        confirmed = 0.0
    return {
        "infeasible": bool(excluded * (1.0 + _ROUNDING) < 1.0),
        "load_factor": [confirmed, excluded if np.isfinite(excluded) else None],
        "reason": _LIMIT_PROVED,
    }


def _excluded(state: SolvedState, triangles: Triangles, contacts: list[ContactTractions]) -> float:
    """The least factor on u_D that a stress excludes, infinite if no stress excludes any."""
    problem, element = state.problem, macro_element(1)
    held = held_components(state, triangles)
    loads = BalancedLoads.none(triangles, element)
    forces = balanced_forces(triangles, held, loads, contacts)
    material = Body(state, triangles, element)
    strains, limit = material.strains(problem.u), material.limit
    if on_any_rank(state.comm, ~np.isfinite(limit)):
        raise NotApplicable("nothing limits the strain in a part of the body")
    system = HybridSystem(triangles, element, forces, state.settings.linear)
    # |Z| of the last iterate, raised by a share of its mean.
    size = np.linalg.norm(state.points.locking_stress, axis=(1, 2))
    size = size + (state.sum(size * triangles.areas) / state.points.volume or 1.0)
    areas, mass = triangles.areas[:, None] / 3.0, element.mass
    nodal = problem.u.x.array.reshape(-1, 2)

    def factor(stress: FloatArray) -> float:
        """``(int M |s| + int p gap)/int s nu . u_D``; infinite if the divisor is rounding.

        ``|s|`` is convex, so that the mean of its values at the corners of a part is an upper
        bound.
        """
        work = np.sum(np.sum(stress * (mass @ strains), axis=(2, 3)) * areas)
        sizes = np.linalg.norm(stress, axis=3).mean(axis=2)
        resistance = np.sum(limit[:, None] * sizes * areas)
        for contact in contacts:
            normal, _ = contact.split(nodal)
            work += contact.lengths @ product_integral(contact.pressure, normal)
            resistance += contact.lengths @ product_integral(contact.pressure, contact.gap)
        work, resistance = (state.sum(np.asarray(value)) for value in (work, resistance))
        resistance = max(resistance, 0.0)
        return resistance / work if work > _ROUNDING * resistance else np.inf

    best = np.inf
    for _ in range(_STEPS):
        weights = limit / np.maximum(size, _LEAST * maximum(state.comm, size))
        soft = np.multiply.outer(weights, np.eye(3))[:, None, None]
        soft = np.broadcast_to(soft, (len(weights), 3, 4, 3, 3))
        stress, jump = system.solve(soft, strains)
        whole = strains / weights[:, None, None, None]
        largest, most = (maximum(state.comm, np.abs(values)) for values in (stress, whole))
        if largest <= _ROUNDING * most:
            # Nothing resists the prescribed displacements.
            break
        if jump > LARGEST_JUMP:
            raise NotApplicable(f"rounding leaves jumps of {jump:.1e} in the tractions")
        best = min(best, factor(stress))
        size = np.sqrt(np.mean(np.sum(stress**2, axis=3), axis=(1, 2)))
    return best
