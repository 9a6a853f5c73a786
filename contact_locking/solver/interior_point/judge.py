"""Measures of an iterate: its distance from a solution, or a proof that there is none.

It is judged by the scales of its problem.  That no displacement of the mesh is admissible is proved
by Farkas's lemma.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import joint_norm
from contact_locking.errors import NotConverged
from contact_locking.fem import compiled
from contact_locking.parallel import maximum
from contact_locking.problem.rounding import ROUNDING
from contact_locking.problem.system import System
from contact_locking.solver.interior_point.bound_step import MovingBound
from contact_locking.solver.interior_point.contact_cones import FrictionCones, OnContact
from contact_locking.solver.interior_point.family import Family, Reactions
from contact_locking.solver.interior_point.iterate import Iterate
from contact_locking.solver.interior_point.tangent import Tangent
from contact_locking.solver.interior_point.tuning import Tuning
from contact_locking.solver.ksp import linear_failures
from contact_locking.solver.settings import Settings
from contact_locking.solver.task import Target, Task

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
    reactions: Reactions = {family: family.reactions for family in limits}
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
            rho = tangent.answer(tangent.forces(reactions), _ACCURACY)
    except NotConverged:
        return None
    reactions = {f: values - springs[f] * f.see(rho) for f, values in reactions.items()}
    power, resistance = _power(iterate, reactions), _resistance(iterate, reactions)
    resistance += _work_beyond(system, rho, _SMALL_STRAIN)
    # The residual of the linear solve and springs may work along any admissible displacement.
    farthest = system.largest_displacement() + _SMALL_STRAIN * target.length
    resistance += (tangent.residual_forces() + _pull_of_springs(system, rho)) * farthest
    pressed = (f.weights @ np.abs(p) for f, p in reactions.items() if isinstance(f, OnContact))
    resistance += GAP_ROUNDING * target.length * _summed(iterate, pressed)
    # The resistance is infinite if a foundation would have to pull.
    if not power - resistance > _ROUNDING * (abs(power) + abs(resistance)):
        return None
    return resistance / power if resistance > 0.0 else math.inf


def _power(iterate: Iterate, reactions: Reactions) -> float:
    """``B(u)`` at the present displacement; collective."""
    return _summed(iterate, (f.power(values, f.seen) for f, values in reactions.items()))


def _resistance(iterate: Iterate, reactions: Reactions) -> float:
    """R, infinite for a pressure that is negative somewhere; collective."""
    return _summed(iterate, (f.resistance(values) for f, values in reactions.items()))


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
    forces = sum((spring.forces(v) for spring in system.data.springs), np.zeros_like(v.x.array))
    return float(system.comm.allreduce(float(np.abs(forces[: len(system.load)]).sum())))


@dataclass
class Measures:
    """The measures of convergence, all relative."""

    equilibrium: float
    primal: float
    gap: float
    friction: float

    def __str__(self) -> str:
        text = f"equilibrium {self.equilibrium:.1e}, laws {self.primal:.1e}, "
        text += f"duality gap {self.gap:.1e}"
        # Without friction there is no bound to report.
        return f"{text}, friction bound {self.friction:.1e}" if self.friction > 0.0 else text

    def worst(self) -> float:
        return max(self.equilibrium, self.primal, self.gap, self.friction)

    def reached(self, settings: Settings, gap: float) -> bool:
        """Whether all are within the tolerances, the duality gap within ``gap``."""
        return (
            self.equilibrium <= settings.tolerance
            and self.primal <= settings.tolerance
            and self.gap <= gap
            and self.friction <= settings.friction_tolerance
        )


class Judge:
    """Measures equilibrium, laws, duality gap and friction bounds of the iterates of a solve.

    - ``friction_change``: the relative distance of the bounds from ``mu |R p|`` at :meth:`compare`
    - ``leaves_gap``: whether :meth:`measure` accepted a large gap because of rounding in the cones
    """

    def __init__(self, task: Task, tangent: Tangent, tuning: Tuning) -> None:
        self._task, self._tangent, self._tuning = task, tangent, tuning
        self._least_energy = self.least_force = self.friction_change = 0.0
        self.leaves_gap = False

    def begin(self, strain: float) -> None:
        """Set the least scales of energy and force, by the strain at the start."""
        target = self._task.target
        energy = target.ellipticity * strain**2 * target.volume
        self._least_energy = self._tuning.least_energy * energy
        self.least_force = self._least_energy / ((strain or 1.0) * target.length)

    def measure(self, iterate: Iterate) -> Measures:
        """Update the tangent and measure the iterate; collective."""
        tangent, target = self._tangent, self._task.target
        tangent.update()
        tolerance = self._task.settings.tolerance
        strain = self.mean_strain(tolerance)
        # The gap bounds the square of an error, so it is compared with the square of the rounding.
        least_strain = self.mean_strain(math.sqrt(tolerance))
        energy = 0.5 * target.ellipticity * least_strain**2 * target.volume
        energy = max(energy, self._tuning.locking_share * iterate.body_work())
        scale = max(tangent.force_scale, self.least_force)
        # A gap of products that are only rounding has to be accepted.
        product, energy = iterate.measure * iterate.mean_product(), max(energy, self._least_energy)
        large = self._tuning.large_gap * self._tuning.gap_tolerance
        self.leaves_gap = product > large * energy
        energy = max(energy, iterate.least_product() / self._tuning.gap_tolerance)
        # Without any energy, as of a body that nothing has touched yet, the gap is 0.
        gap = product / energy if energy > 0.0 else (math.inf if product > 0.0 else 0.0)
        return Measures(
            iterate.equilibrium_residual(scale, tolerance),
            iterate.primal_residual(strain * target.length),
            gap,
            self.friction_change,
        )

    def compare(self, moving: Sequence[MovingBound]) -> tuple[list[FloatArray], list[FloatArray]]:
        """The bounds ``mu |R p|`` by the law, and those that the cones use; collective."""
        contacts = [bound.contact for bound in moving]
        by_law = [bound.evaluate() for bound in moving]
        used = [values.copy() for values in by_law]
        for bound, values in zip(moving, used, strict=True):
            bound.friction.nodes.scatter(bound.friction.bound, values)
        distances = [a - b for a, b in zip(by_law, used, strict=True)]
        least = self._task.target.least_bound(self.mean_strain(self._task.settings.tolerance))
        size = max(joint_norm(contacts, by_law), least)
        self.friction_change = joint_norm(contacts, distances) / size if size > 0.0 else 0.0
        return by_law, used

    def keeps_penalty_law(self, iterate: Iterate) -> bool:
        """Whether every locking stress is near that of (23) at the displacement; collective."""
        limited, comm, target = iterate.limits_of_strain, iterate.comm, self._task.target
        size = target.ellipticity * self.mean_strain(self._task.settings.tolerance)
        size = max([size, *(maximum(comm, np.abs(f.reactions)) for f in limited)])
        return all(
            maximum(comm, np.abs(f.reactions - f.penalised)) <= self._tuning.off_law * size
            for f in limited
        )

    def mean_strain(self, tolerance: float) -> float:
        """The mean strain of the iterate, at least that of rounding; collective."""
        displacement = self._task.system.largest_displacement()
        return self._task.target.mean_strain(self._tangent.energy, displacement, tolerance)
