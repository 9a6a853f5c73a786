"""Judges an iterate by the scales of its problem."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import joint_norm
from contact_locking.parallel import maximum
from contact_locking.solver.interior_point.bound_step import MovingBound
from contact_locking.solver.interior_point.iterate import Iterate
from contact_locking.solver.interior_point.tangent import Tangent
from contact_locking.solver.interior_point.tuning import Tuning
from contact_locking.solver.settings import Settings
from contact_locking.solver.task import Task


@dataclass
class Measures:
    """The measures of convergence, all relative."""

    equilibrium: float
    primal: float
    gap: float
    friction: float

    def __str__(self) -> str:
        told = f"equilibrium {self.equilibrium:.1e}, laws {self.primal:.1e}, "
        told += f"duality gap {self.gap:.1e}"
        # Without friction, and where friction holds everything, no bound moves.
        return f"{told}, friction bound {self.friction:.1e}" if self.friction > 0.0 else told

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

    ``friction_change`` is how far the friction bounds were from ``mu |R p|`` at the last
    :meth:`compare`, relative.  ``leaves_gap`` says that rounding in the cones excused a duality gap
    at the last :meth:`measure` that is large beside the energy.
    """

    def __init__(self, task: Task, tangent: Tangent, tuning: Tuning) -> None:
        self._task, self._tangent, self._tuning = task, tangent, tuning
        self._least_energy = self.least_force = self.friction_change = 0.0
        self.leaves_gap = False

    def begin(self, strain: float) -> None:
        """Let no energy and no force be judged by less than a share of those of a strain."""
        target = self._task.target
        energy = target.ellipticity * strain**2 * target.volume
        self._least_energy = self._tuning.least_energy * energy
        self.least_force = self._least_energy / ((strain or 1.0) * target.length)

    def measure(self, iterate: Iterate) -> Measures:
        """Look at the iterate and judge it; collective."""
        tangent, target = self._tangent, self._task.target
        iterate.visit()
        tolerance = self._task.settings.tolerance
        strain = self.mean_strain(tolerance)
        # The gap bounds the square of an error, so that it is the square of the rounding that must
        # come below the tolerance of it.
        told = self.mean_strain(math.sqrt(tolerance))
        energy = 0.5 * target.ellipticity * told**2 * target.volume
        energy = max(energy, self._tuning.locking_share * iterate.body_work())
        scale = max(tangent.force_scale, self.least_force)
        # Cones whose products are rounding have no inside left.
        product, energy = iterate.total_product(), max(energy, self._least_energy)
        large = self._tuning.gap_left * self._tuning.gap_tolerance
        self.leaves_gap = product > large * energy
        energy = max(energy, iterate.least_product() / self._tuning.gap_tolerance)
        # A body that nothing has touched yet is at rest.
        gap = product / energy if energy > 0.0 else (math.inf if product > 0.0 else 0.0)
        return Measures(
            iterate.equilibrium_residual(scale, tolerance),
            iterate.primal_residual(strain * target.length),
            gap,
            self.friction_change,
        )

    def compare(self, moving: Sequence[MovingBound]) -> tuple[list[FloatArray], list[FloatArray]]:
        """The bounds ``mu |R p|`` of the pressure, and those of the cones; collective."""
        contacts = [item.contact for item in moving]
        wanted = [item.evaluate() for item in moving]
        used = [values.copy() for values in wanted]
        for item, values in zip(moving, used, strict=True):
            item.friction.nodes.scatter(item.friction.bound, values)
        left = [a - b for a, b in zip(wanted, used, strict=True)]
        least = self._task.target.least_bound(self.mean_strain(self._task.settings.tolerance))
        size = max(joint_norm(contacts, wanted), least)
        self.friction_change = joint_norm(contacts, left) / size if size > 0.0 else 0.0
        return wanted, used

    def keeps_penalty_law(self, iterate: Iterate) -> bool:
        """Whether no locking stress is far from that of (23) at the displacement; collective."""
        limited, comm, target = iterate.limits_of_strain, iterate.comm, self._task.target
        size = target.ellipticity * self.mean_strain(self._task.settings.tolerance)
        size = max([size, *(maximum(comm, np.abs(f.reactions)) for f in limited)])
        return all(
            maximum(comm, np.abs(f.reactions - f.penalised)) <= self._tuning.off_law * size
            for f in limited
        )

    def mean_strain(self, tolerance: float) -> float:
        """The strain that the iterate is judged by; collective."""
        displacement = self._task.system.largest_displacement()
        return self._task.target.mean_strain(self._tangent.energy, displacement, tolerance)
