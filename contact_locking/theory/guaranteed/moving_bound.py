"""From the bound for the frozen friction bound to one for Coulomb's law, whose bound moves.

    |u - u_h|_a <= e + (kappa e' + c r)/(1 - kappa),    r = |mu R |s_nu| - G_h|  in L2(Gamma_C),

with the bounds e and e' of energy norm and stress (`FrozenBound`).  c is the upper bound of
:func:`slip_constant` if kappa is below 1 with it, and else that of the displacements on the mesh:
the result is an estimate then.  The proof is in docs/certificate.md.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.certificate.elliptic import NotApplicable, largest_eigenvalue
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.contact.nodal_contact import joint_norm
from contact_locking.mesh.rank_sums import summed
from contact_locking.parallel import maximum, on_every_rank
from contact_locking.theory.guaranteed.bars import Bars
from contact_locking.theory.guaranteed.body import Elasticity
from contact_locking.theory.guaranteed.boundary_conditions import held_components
from contact_locking.theory.guaranteed.contact_tractions import ContactTractions
from contact_locking.theory.guaranteed.data_oscillation import BalancedLoads, trace_constants
from contact_locking.theory.guaranteed.energy_bound import FrozenBound
from contact_locking.theory.guaranteed.facet_polynomials import product_integral
from contact_locking.theory.guaranteed.floating import forces_in_balance
from contact_locking.theory.guaranteed.hybrid_system import HybridSystem
from contact_locking.theory.guaranteed.macro_element import macro_element
from contact_locking.theory.guaranteed.triangles import Triangles
from contact_locking.theory.kappa import Kappa

_PROVED = (
    "proved with the friction bound that moves and mu and R by their values at the nodes, on the "
    "polygon of the mesh, with a material that is constant in each cell; up to rounding, 1e-6 of "
    "two eigenvalues and the tolerance of the solver"
)
_ESTIMATED = (
    "estimated, with the friction bound that moves and mu and R by their values at the nodes: c is "
    "that of the displacements on this mesh, from below; with {above:.3g}, from above, kappa is "
    "{kappa:.3g}"
)
# The room for what two eigenvalues to a relative 1e-6 may lack.
_ROOM = 1e-5
# The tractions of the constant of the slip are affine on each facet.
_DEGREE = 1


def moving_error(
    state: SolvedState, frozen: FrozenBound | None, small: Kappa | NotApplicable
) -> dict[str, Any]:
    """``energy_norm``, ``relative``, and ``reason``: of what the bound is, or why there is none.

    Collective.  ``estimated`` says whether it is an estimate, ``kappa`` is that of the bound, and
    ``residual`` is r.
    """
    try:
        return _bound(state, frozen, small)
    except NotApplicable as failure:
        none = dict.fromkeys(("relative", "energy_norm", "kappa", "residual", "estimated"))
        return {**none, "reason": f"not applicable: {failure}"}


def _bound(
    state: SolvedState, frozen: FrozenBound | None, small: Kappa | NotApplicable
) -> dict[str, Any]:
    if frozen is None:
        raise NotApplicable("there is no bound for the friction bound kept fixed")
    if isinstance(small, NotApplicable):
        raise NotApplicable(f"there is no kappa, as {small}")
    if not small.is_small:
        raise NotApplicable(f"kappa = {small.value:.3g} is not below 1")
    contacts = [item.fields.contact for item in frozen.contacts]
    residual = joint_norm(contacts, [_residual(item) for item in frozen.contacts])
    rubbing = [item for item in frozen.contacts if not item.fields.contact.friction.frictionless]
    slip = (1.0 + _ROOM) * slip_constant(state, frozen.elasticity, rubbing)
    above = Kappa(slip, small.lift)
    used = above if above.is_small else small
    more = used.value * frozen.stress + used.trace * residual
    found = frozen.energy_norm + more / (1.0 - used.value)
    estimated = _ESTIMATED.format(above=slip, kappa=above.value)
    return {
        "relative": state.relative(found),
        "energy_norm": found,
        "kappa": used.value,
        "residual": residual,
        "estimated": not above.is_small,
        "reason": _PROVED if above.is_small else estimated,
    }


def _residual(tractions: ContactTractions) -> FloatArray:
    """``mu R |s_nu| - G_h`` (k,) by its control values at the nodes of a contact; collective."""
    contact = tractions.fields.contact
    surface, bound = contact.surface, contact.friction
    if tractions.pressure.shape[1] > 2 and surface.limited.are_nodal:
        raise NotApplicable("contact acts at the nodes of quadratic displacements")
    if not on_every_rank(surface.domain.comm, bound.smoothing.is_positive()):
        raise NotApplicable("R has negative entries")
    shares = np.empty((*tractions.nodes.shape, 1))
    for number in range(shares.shape[1]):
        one = np.zeros_like(tractions.pressure)
        one[:, number] = 1.0
        shares[:, number, 0] = tractions.lengths * product_integral(tractions.pressure, one)
    work = summed(surface.scalar_space.dofmap.index_map, tractions.nodes, shares)[:, 0]
    pressure = contact.acting(work[surface.nodes] / surface.weights)
    moved = bound.evaluate(pressure, np.zeros(len(pressure)))
    return contact.rubbing(moved - tractions.fields.bound)


def slip_constant(
    state: SolvedState, elasticity: Elasticity, contacts: list[ContactTractions]
) -> float:
    """An upper bound of the c of the contacts together; collective.

        c^2 <= c_0^2 + max_K sum_F C_F^2/alpha_K,   c_0 = max |s_g|/|g| with |s_g| in that of A^-1,

    up to the accuracy of one eigenvalue, for stresses s_g with ``div s_g = 0`` and the traction
    ``g t`` along the tangent t of Gamma_C that is affine on each facet, and the constants C_F of
    the trace.  The proof is in docs/certificate.md.  Raises NotApplicable if a linear solve or the
    eigenvalue solver fails.
    """
    triangles, element = Triangles(state.problem.domain), macro_element(_DEGREE)
    held, size = held_components(state, triangles), len(triangles.areas)
    cells = np.concatenate([item.cells for item in contacts])
    sides = np.concatenate([item.sides for item in contacts])
    tangents = np.concatenate([item.tangent for item in contacts])
    # Of orthonormal polynomials on each facet, in the direction that all ranks share.
    scale = np.sqrt(triangles.lengths[cells, sides])
    signs = triangles.signs[cells, sides, None] ** np.arange(_DEGREE + 1)
    shapes = (scale[:, None] * signs)[:, :, None] * tangents[:, None]
    loads = BalancedLoads.none(triangles, element)
    forces, _ = forces_in_balance(state.problem, triangles, element, held, loads, [])
    bars = Bars(triangles, _DEGREE, held)
    system = HybridSystem(triangles, element, forces, bars, state.settings.linear)
    quarters = len(element.quarters)
    with system.traces(elasticity.compliance(np.zeros((size, 3, quarters)))) as traces:

        def apply(values: FloatArray) -> FloatArray:
            moments = np.zeros_like(forces.moments)
            moments[cells, sides] = values.reshape(-1, _DEGREE + 1, 1) * shapes
            return np.sum(traces(moments)[cells, sides] * shapes, axis=2).reshape(-1)

        resolved = largest_eigenvalue(state.comm, len(cells) * (_DEGREE + 1), apply)
    rest = np.zeros(size)
    np.add.at(rest, cells, trace_constants(triangles)[cells, sides] ** 2)
    return math.sqrt(resolved + maximum(state.comm, rest / elasticity.eigenvalues[:, 0]))
