"""A proof that no displacement of the body follows the prescribed values, on no mesh.

No field follows the multiple f of them for ``f > (int M |s| + int p gap)/int s nu . u_D``, with any
stress s in balance that has the traction ``-p nu``, ``p >= 0``, on Gamma_C (docs/certificate.md).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.certificate.elliptic import NotApplicable, require_still_foundations
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.parallel import maximum, on_any_rank
from contact_locking.theory.guaranteed.body import Body
from contact_locking.theory.guaranteed.boundary import (
    ContactTractions,
    balanced_forces,
    contact_tractions,
    held_components,
    require_exact_gaps,
    require_straight_triangles,
)
from contact_locking.theory.guaranteed.data_oscillation import BalancedLoads
from contact_locking.theory.guaranteed.hybrid_system import LARGEST_JUMP, HybridSystem
from contact_locking.theory.guaranteed.triangles import Triangles, macro_element, product_integral

# Reweighted steps, and the least weight over the largest.
_STEPS, _LEAST = 8, 1e-4
# The share of the displacements of the mean strain by which a held node may enter the foundation.
_ADMISSIBLE = 1e-6
# Rounding in the factor.
_ROUNDING = 1e-8
_PROVED = "proved for every displacement of the polygon of the mesh, up to rounding"


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
        contacts = _pushing(state, triangles)
        excluded = _excluded(state, triangles, contacts or [])
    except NotApplicable as failure:
        reason = f"not applicable: {failure}"
        return {"infeasible": None, "load_factor": None, "reason": reason}
    confirmed = 0.0
    if state.report.converged and state.target.penalty.is_inequality:
        confirmed = 1.0
    elif state.report.admissible_factor is not None:
        confirmed = state.report.admissible_factor[0]
    nodal = confirmed * state.problem.u.x.array.reshape(-1, 2)
    depth = [(item.split(nodal)[0] - item.gap)[item.fixed] for item in contacts or []]
    deepest = max((item.max(initial=0.0) for item in depth), default=0.0)
    allowed = _ADMISSIBLE * state.mean_strain * state.target.length
    if contacts is None or maximum(state.comm, deepest) > allowed:
        confirmed = 0.0
    return {
        "infeasible": bool(excluded * (1.0 + _ROUNDING) < 1.0),
        "load_factor": [confirmed, excluded if np.isfinite(excluded) else None],
        "reason": _PROVED,
    }


def _excluded(state: SolvedState, triangles: Triangles, contacts: list[ContactTractions]) -> float:
    """The least factor on u_D that a stress excludes, infinite if no stress excludes any."""
    problem, element = state.problem, macro_element(1)
    held = held_components(state, triangles)
    loads = BalancedLoads.none(triangles, element)
    forces = balanced_forces(triangles, held, loads, contacts)
    material = Body(state, triangles, element)
    strains, limit = material.strains(problem.u, element), material.limit
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


def _pushing(state: SolvedState, triangles: Triangles) -> list[ContactTractions] | None:
    """Tractions without friction; None where no polynomial has the gap, which proves less.

    Collective.
    """
    try:
        found = [contact_tractions(fields, triangles) for fields in state.contacts]
        require_exact_gaps(state, triangles, found)
    except NotApplicable:
        return None
    return [replace(item, along=np.zeros_like(item.along)) for item in found]
