"""A proof by Farkas's lemma that no displacement of the mesh is admissible."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
import ufl
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.errors import NotConverged
from contact_locking.fem import compiled
from contact_locking.problem.rounding import ROUNDING
from contact_locking.problem.system import System
from contact_locking.solver.interior_point.contact_cones import FrictionCones, OnContact
from contact_locking.solver.interior_point.family import Family, Reaction
from contact_locking.solver.interior_point.iterate import Iterate
from contact_locking.solver.ksp import linear_failures
from contact_locking.solver.task import Target

# The stiffness k that balances the multipliers, over that of the material.
_STIFFER = 1e6
# The strain assumed as the limit of cells without one, because the model is of small strains.
_SMALL_STRAIN = 1.0
# The relative rounding of either side.
_ROUNDING = 1e-6
# The rounding of a gap over the length of the body.
GAP_ROUNDING = 10.0 * ROUNDING
# The accuracy of an iterative linear solve.
_ACCURACY = 1e-10


def excluded_factor(iterate: Iterate, target: Target) -> float | None:
    """The least factor on the prescribed values u_D that the multipliers prove impossible.

    Let ``B(v) = int Z : eps(v) + int p v_nu`` for any Z and ``p >= 0``.  If B vanishes for every v
    that is zero where displacements are prescribed, then ``P = B(u)`` is the same for every field
    with the values u_D, and s P for those with s u_D.  But B is at most ``R = int M |Z| + int p
    gap`` if ``|eps| <= M`` and ``u_nu <= gap``.  So no admissible field on this mesh has the values
    s u_D with ``s > R/P``.  With several sets of strains Z is the sum of ``L^T y`` over them, and
    ``M |y|``, with ``y >= 0`` for a half space, takes the place of ``M |Z|``.

    The multipliers of ``iterate`` do not quite balance each other.  With

        int (A + k) eps(rho) : eps(v) + int (k/L) rho_nu v_nu = B(v)

    ``Z - k eps(rho)`` and ``p - (k/L) rho_nu`` do, except for ``a(rho, v)``, which adds at most
    ``int c |eps(rho)| (M + |eps(u)|)`` to R, with the largest eigenvalue c of A.  Where no set
    bounds the norm of the strain, 1 is used for M.  The residual forces of the linear solve and
    the forces of springs at rho, times the largest ``|u|`` plus the length of the body, are added
    to R as well, on the assumption that no field with strains below 1 is farther away.

    Pushed foundations may retreat, and so the proof omits their contacts.

    None without a proof that ``P > R``: also if the linear solver fails, or if rho is not
    determined because friction or a pushed foundation has to hold the body.  Infinite if R is
    negative: then the gap alone has no admissible field, and scaling u_D does not help.
    Collective.
    """
    tangent = iterate.tangent
    system = tangent.system
    limits = [
        family
        for family in iterate.families
        if not (isinstance(family, FrictionCones) or family.tool is not None)
    ]
    reactions = Reaction.of(limits)
    is_open = system.held_by_friction or (system.held_by_contact and system.tools)
    if is_open or not _resistance(iterate, reactions) < _power(iterate, reactions):
        return None
    largest = iterate.largest_multiplier()
    springs: dict[Family, float | FloatArray] = dict.fromkeys(tangent.families, 0.0)
    for family in limits:
        # Without other supports the springs would let rho become large.
        is_held = not (system.held_by_contact or system.data.springs)
        if not (is_held and isinstance(family, OnContact)):
            most = _STIFFER * target.stiffness / family.scale
            springs[family] = family.holding(most, largest)
    for family, stiffness in springs.items():
        family.hold(stiffness)
    tangent.refresh()
    try:
        with linear_failures():
            rho = tangent.balance(reactions, _ACCURACY)
    except NotConverged:
        return None
    reactions = [
        Reaction(item.family, item.values - springs[item.family] * item.family.see(rho))
        for item in reactions
    ]
    power, resistance = _power(iterate, reactions), _resistance(iterate, reactions)
    resistance += _work_beyond(system, rho, _SMALL_STRAIN)
    # The residual of the linear solve and springs may work along any admissible displacement.
    farthest = system.largest_displacement() + _SMALL_STRAIN * target.length
    resistance += (tangent.residual_forces() + _pull_of_springs(system, rho)) * farthest
    pressures = [item for item in reactions if isinstance(item.family, OnContact)]
    pressed = (float(item.family.weights @ np.abs(item.values)) for item in pressures)
    resistance += GAP_ROUNDING * target.length * _summed(iterate, pressed)
    # The resistance is infinite if a foundation would have to pull.
    if not power - resistance > _ROUNDING * (abs(power) + abs(resistance)):
        return None
    return resistance / power if resistance > 0.0 else math.inf


def _power(iterate: Iterate, reactions: Sequence[Reaction]) -> float:
    """``B(u)`` at the present displacement; collective."""
    return _summed(
        iterate, (item.family.power(item.values, item.family.seen) for item in reactions)
    )


def _resistance(iterate: Iterate, reactions: Sequence[Reaction]) -> float:
    """R, infinite for a pressure that is negative somewhere; collective."""
    return _summed(iterate, (item.family.resistance(item.values) for item in reactions))


def _summed(iterate: Iterate, local: Iterable[float]) -> float:
    return float(iterate.comm.allreduce(sum(local)))


def _work_beyond(system: System, displacement: FloatArray, unlimited: float) -> float:
    """``int c |eps(v)| (M + |eps(u)|)`` of ``v`` (owned values), u being the system's.

    c is the largest eigenvalue of A, and ``unlimited`` takes the place of an infinite M;
    collective.
    """
    v, data = system.function_of(displacement), system.data
    inverse = data.inverse_strain_bound
    limit = ufl.conditional(ufl.gt(inverse, 0.0), 1.0 / ufl.max_value(inverse, 1e-300), unlimited)
    strains = [data.strain(w) for w in (v, system.u)]
    sizes = [ufl.sqrt(ufl.inner(eps, eps)) for eps in strains]
    form = data.largest_eigenvalue * sizes[0] * (limit + sizes[1]) * data.dx
    return float(system.comm.allreduce(fem.assemble_scalar(compiled.form(form))))


def _pull_of_springs(system: System, displacement: FloatArray) -> float:
    """The sum of the nodal forces of springs at a displacement (owned values); collective."""
    if not system.data.springs:
        return 0.0
    v = system.function_of(displacement)
    forces = sum((item.forces(v) for item in system.data.springs), np.zeros_like(v.x.array))
    return float(system.comm.allreduce(float(np.abs(forces[: len(system.load)]).sum())))
