"""Newton's method on the pieces of the laws, which takes few tangents if few pieces change.

The laws of contact, friction and strain limits are semismooth equations (:class:`~cones.Pieces`),
and Newton's method on them ends as soon as every point is on the right piece.  From the elastic
displacement this takes a few steps for contact and friction, and from the previous step of a
process also for strain limits.  Far from the solution the method fails, and gives up early.  If
nothing presses the body, many positions are solutions, and the interior point method finds one
away from the foundations.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import NotConverged
from contact_locking.parallel import on_any_rank, on_every_rank
from contact_locking.solver.interior_point.bound_step import BoundStep, MovingBound
from contact_locking.solver.interior_point.cones import Composite, Pair, Pieces
from contact_locking.solver.interior_point.contact_cones import ContactCones
from contact_locking.solver.interior_point.family import Direction, Family
from contact_locking.solver.interior_point.half_lines import HalfLinePieces
from contact_locking.solver.interior_point.iterate import Iterate
from contact_locking.solver.interior_point.judge import Judge
from contact_locking.solver.interior_point.locking_cones import LimitsOfStrain
from contact_locking.solver.interior_point.slips import SlipPieces
from contact_locking.solver.interior_point.tangent import Tangent
from contact_locking.solver.interior_point.tuning import Tuning
from contact_locking.solver.ksp import linear_failures
from contact_locking.solver.task import SavedState, Task

# The stiffness of rigid laws in a step, over that of the body.
_STIFFEST = 1e7
# The stiffness of open contact over that of the springs at the start, if contact has to hold the
# body.
_FLOOR = 1e-8
# The largest share of points that may exceed their limit at the elastic displacement.
_BEYOND = 0.01
# The relative residual of the linear system for the step of the bound, and the most iterations for
# it.  Rougher steps take more tangents.
_BOUND_RTOL, _BOUND_ITERATIONS = 1e-8, 60
# The tangent is kept if no point has changed its piece, the residual is below the first number, and
# each step reduces it to at most the second share.
_KEEPS_BELOW, _KEPT_GAIN = 1e-2, 0.2
# A residual above this, relative to the forces, means that the method diverges.
_FAR = 10.0
_EXCESS = 1e-7  # of the strain beyond its limit, as a share of the limit
# One to three steps have to reduce the residual or the number of changed points by this factor.
_GAIN = 0.5
_MOST_STEPS = 15
# If at most so many points change in turns, c of friction is raised by the factor.
_FEW_CHANGE, _SHARPER = 4, 10.0
# The products of the pairs that :meth:`ActiveSet.last` returns, over the density of the elastic
# energy.
_PRODUCT = 1e-10
FAILURE = "Newton's method on the pieces of the laws does not converge"


@dataclass(frozen=True)
class _Progress:
    """The worst measure after a step, that of the forces, and the number of changed points."""

    worst: float
    unbalanced: float
    changed: int

    def is_less_than(self, before: _Progress, factor: float) -> bool:
        fewer = before.changed > 0 and self.changed <= factor * before.changed
        return fewer or self.worst <= factor * before.worst


class ActiveSet:
    """Newton's method on the pieces, for all families and friction bounds of a system.

    It needs a direct linear solver.  Unless ``bound_moves`` friction bounds stay in force.  Methods
    are collective.
    """

    def __init__(
        self,
        task: Task,
        tangent: Tangent,
        bounds: Sequence[MovingBound],
        bound_moves: bool,
        judge: Judge,
        tuning: Tuning,
    ) -> None:
        self._task, self._tangent, self._judge = task, tangent, judge
        #: The duality gap of the solution.
        self.gap = 0.0
        self._tuning = dataclasses.replace(
            tuning,
            bound_most_taken=1.0,
            bound_rtol=_BOUND_RTOL,
            bound_iterations=_BOUND_ITERATIONS,
        )
        target = task.target
        self._springs = float(task.system.held_by_contact) * target.ellipticity / target.length
        # Pieces allow friction bounds of zero.
        self._moving = [dataclasses.replace(bound, least=0.0) for bound in bounds if bound_moves]
        self._fixed = [] if bound_moves else list(bounds)
        self._cones = Composite(tangent.families)
        self._laws: dict[Family, Pieces[Any]] = {
            family: family.pieces(target.stiffness, _STIFFEST) for family in tangent.families
        }
        for law in self._laws.values():
            if isinstance(law, HalfLinePieces) and isinstance(law.cone, ContactCones):
                law.floor = _FLOOR * self._springs

    # The start.

    def from_elastic(self) -> Iterate | None:
        """Solve from the elastic displacement, which is restored if that fails."""
        beyond = np.zeros(2)
        self._tangent.update()
        for family, law in self._laws.items():
            family.takes_part = True
            family.z[:] = 0.0
            law.start(np.zeros_like(family.seen))
            if isinstance(family, ContactCones):
                # The forces of the springs that have held the body.
                law.start(self._springs * np.maximum(family.seen - family.limit, 0.0))
                family.z = law.y
            if isinstance(family, LimitsOfStrain):
                beyond += np.count_nonzero(family.reach > family.limit), len(family.limit)
        few, points = self._tangent.comm.allreduce(beyond)
        if few > _BEYOND * points:
            return None
        return self._solve_or_restore(is_linearised=False)

    def from_last(self, last: SavedState) -> Iterate | None:
        """As :meth:`from_elastic`, from the solution of the previous step.

        The system has the prescribed displacements of the present step.  The first Newton step uses
        the pieces of that solution and the change of the prescribed displacements.  None as well if
        the pairs of ``last`` do not have the shapes of these laws.
        """
        system, families = self._task.system, self._tangent.families
        fits = len(families) == len(last.cones) and all(
            pair is None or pair[1].shape == family.z.shape
            for family, pair in zip(families, last.cones, strict=True)
        )
        if not on_every_rank(self._tangent.comm, fits):
            return None
        start = system.u.x.array.copy(), system.tools.travels
        moved = system.constraints.held_part(start[0] - last.displacement)
        # If supports move, nodes that slid start sticking: sliding would strain the surface next to
        # the contact more, and more points would change their piece.
        slides_on = not on_any_rank(self._tangent.comm, moved != 0.0)
        system.u.x.array[:] = last.displacement
        if len(last.travels) == len(system.tools):
            system.tools.travels = last.travels
        self._tangent.update()
        self._judge.begin(self._judge.mean_strain(self._task.settings.tolerance))
        for (family, law), pair in zip(self._laws.items(), last.cones, strict=True):
            family.takes_part = True
            x, z = (np.zeros_like(family.x), np.zeros_like(family.z)) if pair is None else pair
            law.resume((slides_on * x, z))
            for bound in self._fixed:
                if bound.friction is family:
                    family.z[0] = bound.friction.nodes.of_all(bound.in_force)
            law.linearise()
            law.evaluate()
        before = {law: law.cone.seen for law in self._laws.values()}
        system.constraints.apply(system.u)
        self._tangent.update()
        for law, seen in before.items():
            law.extrapolate(seen)
        iterate = self._solve_or_restore(is_linearised=True)
        if iterate is None:
            system.u.x.array[:], system.tools.travels = start
        return iterate

    def last(self) -> SavedState:
        """The solution with pairs inside the cones, as the interior point method has them."""
        target, system = self._task.target, self._task.system
        strain = self._judge.mean_strain(self._task.settings.tolerance)
        product = _PRODUCT * target.ellipticity * strain**2
        # Without strains there are no products to choose.
        moves = product > 0.0
        cones: dict[Family, Pair | None] = {
            family: law.inside(product) if moves else None for family, law in self._laws.items()
        }
        for moving in self._moving if moves else ():
            # The bound is that of the pressure inside its cones.  A zero bound has no cones.
            pressing, rubbing = cones[moving.pressing], self._laws[moving.friction]
            assert pressing is not None and isinstance(rubbing, SlipPieces)
            bound = moving.evaluate_at(pressing[1])
            is_zero = moving.contact.norm(bound) == 0.0
            at_nodes = moving.friction.nodes.of_all(bound)
            cones[moving.friction] = None if is_zero else rubbing.inside_under(at_nodes, product)
        u, travels, penalty = system.u.x.array.copy(), system.tools.travels, target.penalty
        return SavedState(u, travels, penalty, tuple(cones.values()))

    # The iteration.

    def _solve_or_restore(self, is_linearised: bool) -> Iterate | None:
        system = self._task.system
        try:
            with linear_failures(), system.preserved(only_on_failure=True):
                return self._solve(is_linearised)
        except NotConverged:
            self._judge.friction_change = 0.0
            return None

    def _solve(self, is_linearised: bool) -> Iterate:
        """The iterate at the solution; raises NotConverged."""
        task, tangent = self._task, self._tangent
        iterate, laws = Iterate(tangent), self._laws.values()
        progress: list[_Progress] = []
        bound_step: BoundStep | None = None
        keeps = reached = is_cycle = False
        for number in range(min(_MOST_STEPS, task.settings.max_iterations)):
            for law in () if is_linearised else laws:
                if not keeps:
                    law.linearise()
                law.evaluate()
            is_linearised = False
            if keeps:
                assert bound_step is not None
                bound_step.linearise()
            else:
                tangent.refresh()
                task.counts.tangents += 1
                bound_step = BoundStep(self._moving, tangent, self._tuning)
            self._advance(self._direction(bound_step))
            measures = self._judge.measure(iterate)
            measures.primal = max(measures.primal, self._misfit())
            task.monitor.iteration(number, measures.worst())
            reached_before = reached
            reached = measures.reached(task.settings, self._tuning.gap_tolerance)
            if reached and reached_before and self._keeps_limits():
                if self._rests():
                    raise NotConverged("nothing presses the body to the foundations")
                self.gap = max(measures.gap, 0.0)
                return iterate
            if reached:
                # One more step with the same tangent removes most of the residual.
                keeps = True
                continue
            changed = tangent.comm.allreduce(sum(law.changed for law in laws))
            progress.append(_Progress(measures.worst(), measures.equilibrium, int(changed)))
            if self._is_lost(progress):
                is_cycle = is_cycle or not self._moving
                if is_cycle or progress[-1].worst > _FAR or progress[-1].changed > _FEW_CHANGE:
                    raise NotConverged(FAILURE)
                # A larger c breaks a cycle in which nodes stick and slide in turns.
                is_cycle = True
                progress.clear()
                keeps = False
                for bound in self._moving:
                    self._laws[bound.friction].c *= _SHARPER
                continue
            gains = len(progress) > 1 and progress[-1].worst <= _KEPT_GAIN * progress[-2].worst
            kept_well = not keeps or (gains and not reached_before)
            is_near = progress[-1].changed == 0 and progress[-1].worst <= _KEEPS_BELOW
            keeps = is_near and kept_well
        raise NotConverged(FAILURE)

    def _keeps_limits(self) -> bool:
        """Whether no limit of the strain is exceeded where it must not be; collective."""
        limits = [f for f in self._laws if isinstance(f, LimitsOfStrain) and f.compliance == 0.0]
        return on_every_rank(self._tangent.comm, all(f.is_kept(_EXCESS, 0.0) for f in limits))

    def _misfit(self) -> float:
        """The relative residual of the laws that are smooth."""
        local = np.array([law.misfit() for law in self._laws.values()])
        shares = [a / b for a, b in self._tangent.comm.allreduce(local) if b > 0.0]
        return math.sqrt(max(shares, default=0.0))

    def _rests(self) -> bool:
        """Whether forces are rounding, or contact has none although it has to hold the body."""
        bears = any(
            law.y.any() for family, law in self._laws.items() if isinstance(family, ContactCones)
        )
        touches = on_any_rank(self._tangent.comm, bears)
        is_rounding = self._tangent.force_scale < self._judge.least_force
        return is_rounding or (self._springs > 0.0 and not touches)

    def _direction(self, bound_step: BoundStep) -> Direction:
        """The direction together with the steps of the friction bounds that agree with it."""
        bound_step.reset()
        direction = self._direction_of(self._displacement())
        if not self._moving or bound_step.agrees(direction):
            return direction
        change = bound_step.adapt(direction)
        if change is not None:
            return self._direction_of(direction.displacement + change)
        # A bound was cut at zero, so that the steps do not agree: use the direction without change.
        return self._direction_of(self._displacement())

    def _displacement(self) -> FloatArray:
        aims = {family: law.aim for family, law in self._laws.items()}
        step = self._tangent.solve_step(aims, self._task.settings.tolerance)
        if on_any_rank(self._tangent.comm, ~np.isfinite(step)):
            # With NaN the measures would be those of a body at rest.
            raise NotConverged("the step is not finite")
        return step

    def _direction_of(self, du: FloatArray) -> Direction:
        steps = (law.step(family.see(du)) for family, law in self._laws.items())
        return Direction(du, self._cones.joined(steps), self._cones)

    def _advance(self, direction: Direction) -> None:
        """Take the step, and update the friction bounds to the new pressure."""
        tangent = self._tangent
        if tangent.trusted(1.0, direction.displacement) < 1.0:
            raise NotConverged("the forces of the body are far from those of its tangent")
        tangent.move(1.0, direction.displacement)
        tangent.update()
        steps = self._cones.steps(direction.step)
        for family, law in self._laws.items():
            law.advance(steps[family])
        if not self._moving:
            return
        self._task.counts.updates += 1
        by_law, _ = self._judge.compare(self._moving)
        for bound, values in zip(self._moving, by_law, strict=True):
            bound.set(values)
            bound.friction.z[0] = bound.friction.nodes.of_all(values)
            law = self._laws[bound.friction]
            assert isinstance(law, SlipPieces)
            law.update_cones()

    def _is_lost(self, progress: Sequence[_Progress]) -> bool:
        """Whether the steps so far diverge or make no progress."""
        last, before = progress[-1], progress[-4:-1]
        is_far = last.worst > _FAR and last.unbalanced > _KEEPS_BELOW
        if not np.isfinite(last.worst) or (before and is_far):
            return True
        return len(before) > 1 and not any(last.is_less_than(each, _GAIN) for each in before)
