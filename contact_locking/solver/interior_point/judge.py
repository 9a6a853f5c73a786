"""The measures of convergence of an iterate, relative to the scales of its problem."""

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
        """Update the iterate and measure it; collective."""
        tangent, target = self._tangent, self._task.target
        iterate.update()
        tolerance = self._task.settings.tolerance
        strain = self.mean_strain(tolerance)
        # The gap bounds the square of an error, so it is compared with the square of the rounding.
        least_strain = self.mean_strain(math.sqrt(tolerance))
        energy = 0.5 * target.ellipticity * least_strain**2 * target.volume
        energy = max(energy, self._tuning.locking_share * iterate.body_work())
        scale = max(tangent.force_scale, self.least_force)
        # A gap of products that are only rounding has to be accepted.
        product, energy = iterate.total_product(), max(energy, self._least_energy)
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
