"""The start of the interior point method: elastic displacements, from one factorisation."""

from __future__ import annotations

import math

import numpy as np

from contact_locking.errors import NotConverged
from contact_locking.parallel import maximum, on_every_rank
from contact_locking.problem.motions import prescribed_motion
from contact_locking.solver.interior_point.contact_cones import ContactCones, OnContact
from contact_locking.solver.interior_point.family import Reactions
from contact_locking.solver.interior_point.locking_cones import LimitsOfStrain
from contact_locking.solver.interior_point.tangent import Tangent
from contact_locking.solver.interior_point.tuning import Tuning
from contact_locking.solver.task import Task

# A second solve usually suffices; with much rounding a third may help.
_SHARP_SOLVES = 3


class ElasticStart:
    """The displacement without multipliers, ``a(u, v) = (f, v)``, and the start that it gives.

    If contact alone stops a rigid motion, springs stand for the foundation, and act along it, too,
    where there is friction.  Pushed foundations press on the body by such springs.  Methods are
    collective.
    """

    def __init__(self, task: Task, tangent: Tangent, tuning: Tuning) -> None:
        self._task, self._system, self._target = task, task.system, task.target
        self._tangent, self._tolerance, self._tuning = tangent, task.settings.tolerance, tuning
        #: The mean strain of the elastic displacement.
        self.strain = 0.0
        self._carried, self._springs_hold = 0.0, False

    def solve(self) -> bool:
        """Set the system to the elastic displacement; True if that is the solution."""
        tangent, tuning = self._tangent, self._tuning
        self._move_rigidly()
        tangent.update()
        if self._system.held_by_contact:
            self._carried = abs(tangent.load_work())
        push = self._set_springs()
        self._springs_hold = bool(push)
        # The rounding of the springs would move a body without loads.
        is_at_rest = tangent.tools_rest and tangent.residual_norms({})[0] == 0.0
        if is_at_rest and self._is_admissible(0.0):
            return True
        start = tangent.present()
        # The steps by the elastic forces together with the springs, and by the loads.
        elastic = -tangent.stretched - tangent.forces(push)
        self._moved = tangent.answer(elastic, tuning.start_accuracy)
        self._loaded = tangent.answer(tangent.load, tuning.start_accuracy)
        if tangent.is_linear:
            tangent.move(1.0, self._moved + self._loaded)
            tangent.update()
        else:
            self._minimise(push)
            self._loaded = tangent.present() - start - self._moved
        is_elastic = not (self._system.tools.act or self._system.held_by_contact)
        is_solution = is_elastic and self._is_admissible(tuning.start_margin)
        if is_solution:
            self._sharpen()
            is_solution = self._is_admissible(0.0)
        self.strain = self._size()
        return is_solution

    def _move_rigidly(self) -> None:
        """Move the body rigidly if the prescribed values are a rigid motion."""
        u, constraints = self._system.u, self._system.constraints
        motion = prescribed_motion(constraints, u.x.array)
        if motion is not None and motion.any():
            # The values may be a share of what the conditions prescribe.
            u.x.array[:] = constraints.free_part(motion) + constraints.held_part(u.x.array)

    def _minimise(self, push: Reactions) -> None:
        """Newton's method on the energy of a body with a user's own energy; may not converge."""
        tangent, tolerance = self._tangent, self._tolerance
        for number in range(self._task.settings.max_iterations):
            springs = {f: pull + f.block(f.seen) for f, pull in push.items()}
            unbalanced = tangent.residual_norms(springs)[0]
            self._task.monitor.iteration(number, unbalanced / (tangent.force_scale or 1.0))
            if unbalanced <= tolerance * tangent.force_scale:
                return
            if not np.isfinite(unbalanced):
                raise NotConverged("the energy of the body is not finite where the solve starts")
            if number > 0:
                tangent.refresh()
                self._task.counts.tangents += 1
            step = tangent.solve_step(springs, tolerance)
            tangent.move(tangent.trusted(1.0, step), step)
            tangent.update()
        raise NotConverged("Newton's method without contact and limits took too many steps")

    def _sharpen(self) -> None:
        """Refine the displacement until the forces are balanced to the tolerance."""
        tangent, accuracy = self._tangent, self._tuning.start_sharpness * self._tolerance
        for _ in range(_SHARP_SOLVES):
            tangent.move(1.0, tangent.step_after(tangent.zeros(), {}, accuracy))
            tangent.update()
            if tangent.residual_norms({})[0] <= self._tolerance * tangent.force_scale:
                break

    def level(self) -> float:
        """The complementarity products per volume at the start.

        A share of the density of the elastic energy, or of the work of loads that contact
        carries.  Springs distribute forces that contact concentrates at a few nodes, whose cells
        may lock at small strains: with springs the level is at least the elastic stress times the
        mean of the limits, because multipliers hardly grow faster than their products.
        """
        elastic = self._target.ellipticity * self.strain**2
        level = self._tuning.start_level * max(elastic, self._carried / self._target.volume)
        if self._springs_hold and (overstrain := self.overstrain()) > 0.0:
            level = max(level, elastic / max(overstrain, self._tuning.least_overstrain))
        return level

    def overstrain(self) -> float:
        """The elastic strain over the mean of the limits, 0 without limits."""
        local = np.zeros(2)
        for family in self._tangent.families:
            if isinstance(family, LimitsOfStrain) and family.bounds_norm:
                local += family.weights @ family.limit, family.weights.sum()
        total, volume = self._tangent.comm.allreduce(local)
        return float(self.strain * volume / total) if volume > 0.0 else 0.0

    def retreat(self) -> float:
        """Reduce the displacement by the loads to a small share; returns the strain then."""
        kept = self._tuning.start_load
        self._tangent.move(kept - 1.0, self._loaded)
        if not math.isfinite(self._system.forms.own_energy(self._system.u)):
            self._tangent.move(1.0 - kept, self._loaded)
        self._tangent.update()
        return max(self._size(), kept * self.strain)

    def _size(self) -> float:
        """The mean strain, at least that which would remove the overlap with the foundation."""
        strain = self._target.mean_strain(self._tangent.energy, 0.0, self._tolerance)
        pressing = [f for f in self._tangent.families if isinstance(f, ContactCones)]
        depths = [np.zeros(1), *(family.seen - family.limit for family in pressing)]
        deepest = maximum(self._tangent.comm, np.concatenate(depths))
        return max(strain, deepest / self._target.length)

    def _set_springs(self) -> Reactions:
        """Assemble the tangent with the springs; returns their reactions at u = 0."""
        springs = self._target.ellipticity / self._target.length
        for family in self._tangent.families:
            family.hold(springs if family in self._sprung else 0.0)
        self._tangent.refresh()
        return {family: family.pull(springs) for family in self._sprung}

    @property
    def _sprung(self) -> list[OnContact]:
        """The families with springs."""
        on_contact = [f for f in self._tangent.families if isinstance(f, OnContact)]
        return [f for f in on_contact if self._system.held_by_contact or f.tool is not None]

    def _is_admissible(self, margin: float) -> bool:
        """Whether no limit is exceeded by more than the share ``margin``."""
        displacement = self._system.largest_displacement()
        keeps = all(family.is_kept(margin, displacement) for family in self._tangent.families)
        return on_every_rank(self._tangent.comm, keeps)


def rests(task: Task, tangent: Tangent) -> bool:
    """Whether no load presses the body and its strains are rounding; collective.

    Then all multipliers are zero, for which the scale of forces at the start is far too large.
    """
    target, tolerance = task.target, task.settings.tolerance
    displacement = task.system.largest_displacement()
    strain = target.mean_strain(tangent.energy, displacement, tolerance)
    if strain > target.mean_strain(0.0, displacement, tolerance):
        return False
    keeps = all(family.is_kept(0.0, displacement) for family in tangent.families)
    if not on_every_rank(tangent.comm, keeps):
        return False
    return tangent.residual_norms({})[0] <= tolerance * tangent.force_scale
