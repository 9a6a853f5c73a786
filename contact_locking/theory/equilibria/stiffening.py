"""Where the solver fails: solutions over the penalty, and on the branch over friction.

With a finite penalty the friction bounds of all solutions have a limit.  As the penalty grows, the
forces either settle, and then the bounds lead to the solution of the target, or they grow with it:
friction wedges the body in.  Such forces balance each other, whatever the loads are, so that
nothing but the penalty gives them their size.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import NotConverged
from contact_locking.laws.penalty import Penalty
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.interior_point.method import InteriorPoint
from contact_locking.solver.strategy import Rescue
from contact_locking.solver.task import Counts, Outcome, SolverReport, Target, Task
from contact_locking.theory.equilibria.bound_map import BoundMap, BoundVectors, MapNewton
from contact_locking.theory.equilibria.search import (
    FARTHEST,
    has_map,
    settled_from,
    sharpened,
    solve_on_branch,
)

# Powers of ten of the penalty over the stiffness of the material: the softest, and the stiffest
# before the inequality itself.
_SOFTEST, _STIFFEST = 1.0, 7.0
# The longest step in powers of ten, the shortest, and how much longer the next may be.
_LONGEST, _SHORTEST, _LONGER = 1.0, 0.1, 1.5
# On the way bounds need not be sharper, and those that show growth may be rougher than those of a
# solution by this factor.  Newton's method takes so many steps at most.
_ROUGH, _EVIDENCE, _FEW = 1e-3, 30.0, 8
# Bounds are foreseen to fall to this share of themselves at most.
_FALL = 0.1
# Forces without a limit grow by this power of the penalty at least, over nearly a power of ten of
# it, some only from 1e6 on, and by no larger power than the last in the step before they are told.
# Forces with a limit hardly grow.
_GROWTH, _OVER, _JUMP = 0.7, 0.9, 1.3
# The force of a penalty that is only as stiff as growth needs, over the force that is enough.
_ENOUGH = 1.3

# The share of the friction coefficient that stands for none.
_LITTLE = 1e-3
_WEDGED_WAY_OUT = (
    "Lower friction.coefficient.  Where friction wedges the body in, the pressure may grow without "
    "a bound, and there may be no equilibrium."
)


@dataclass(frozen=True)
class Stage:
    """A solution with penalties of ``10**power`` times the stiffness of the material.

    ``bounds`` (m,) are its friction bounds, and ``force`` is the sum of its pressures.
    """

    power: float
    target: Target
    bounds: FloatArray
    force: float

    def foreseen(self, before: Stage | None, power: float) -> FloatArray:
        """The bounds at another power, if they go on to grow like the force, or to fall."""
        if before is None or not min(before.force, self.force) > 0.0:
            return self.bounds
        apart = self.power - before.power
        ratio = min(max(self.force / before.force, _FALL), 10.0**apart)
        return np.asarray(self.bounds * ratio ** ((power - self.power) / apart))

    def last_below(self, known: Sequence[Stage]) -> Stage | None:
        """The last of the stages that are nearly a power of ten softer, None without any."""
        return next((item for item in reversed(known) if self.power - item.power >= _OVER), None)

    def growth_from(self, softer: Stage) -> float:
        """The power of the penalty by which the force grows from another stage to this one."""
        if not min(self.force, softer.force) > 0.0:
            return 0.0
        return math.log10(self.force / softer.force) / (self.power - softer.power)

    def growth_in_words(self, known: Sequence[Stage]) -> str:
        """That the force grows from one of the stages to this one, whose state is left, in words.

        "" if none of the stages is softer by enough.
        """
        penalty, softer = self.target.penalty, self.last_below(known)
        if softer is None:
            return ""
        return (
            f"; with penalties of {10.0**softer.power:.2g} and {10.0**self.power:.2g} times the "
            "stiffness of the material there are solutions, and the stiffer one has "
            f"{self.force / softer.force:.2g} times the contact force of the other: its forces "
            "grow with the penalty, and there seems to be no equilibrium without one; the state "
            f"that is left is that of penalty.n: {penalty.n:g}, penalty.epsilon: "
            f"{penalty.epsilon:g} and friction.regularisation: {max(penalty.regularisations):g}"
        )


class Stiffening:
    """The stages of a task, which end after ``most_tangents``; all methods are collective.

    ``found`` is the solution of the last stage, which is in the system, and ``growth`` tells in
    words how forces grow, "" for a solution.  ``folds`` are those of branches over friction on the
    way, and ``counts`` is for what they take.
    """

    def __init__(self, task: Task, most_tangents: float) -> None:
        self._task, self._most_tangents = task, most_tangents
        self.found, self.growth, self.folds, self.counts = Outcome(), "", 0, Counts()
        self._vectors = BoundVectors(task.system) if has_map(task) else None
        #: The power at which the penalties are those of the target, or the stiffest.
        self._last, penalty = _STIFFEST, task.target.penalty
        if math.isfinite(penalty.n) and penalty.epsilon > 0.0:
            stiffest = max(penalty.n, task.target.length / penalty.epsilon)
            self._last = math.log10(stiffest / task.target.stiffness)

    def tried(self) -> Stiffening | None:
        """The stages, with the last solution in the system; None where the penalties lead nowhere.

        The system is then left as it was.
        """
        self._task.monitor.message("following the solutions from softer penalties")
        try:
            with self._task.system.preserved(only_on_failure=True):
                self.growth = self.followed()
            return self
        except NotConverged:
            return None
        finally:
            self._task.counts.add(self.counts)

    def followed(self) -> str:
        """How forces grow over the stages, in words; "" for a solution; raises NotConverged."""
        sharp = self._task.settings.friction_tolerance
        known, without = list[Stage](), math.nan
        can_grow = self._task.target.penalty.epsilon == 0.0
        for stage in self._stages():
            softer = stage.last_below(known)
            grows = softer is not None and stage.growth_from(softer) > _GROWTH
            # A step to another solution may be large.
            grows = grows and _GROWTH < stage.growth_from(known[-1]) < _JUMP
            known.append(stage)
            if not (can_grow and grows):
                continue
            if math.isnan(without):
                found = _force_with_little_friction(self._task)
                without = math.inf if found is None else found
            is_far = stage.force > FARTHEST * without
            is_last = stage.power >= self._last and without < math.inf
            if (is_far or is_last) and (growth := self._shown(known, _ENOUGH * FARTHEST * without)):
                return growth
        is_last = bool(known) and known[-1].power >= self._last and self._vectors is not None
        if is_last and self._arrives(known[-1], self._task.target, sharp):
            return ""
        raise NotConverged("the penalties lead nowhere")

    def _shown(self, known: Sequence[Stage], enough: float) -> str:
        """The growth up to the last stage in words, "" if its bounds are too rough to show it.

        A softer penalty, whose force is ``enough``, may show it then: smaller forces are less
        rough.
        """
        stage, before = known[-1], known[-2]
        if self._is_sharp(stage):
            return stage.growth_in_words(known)
        if not before.force < enough < stage.force:
            return ""
        power = before.power + math.log10(enough / before.force)
        between = self._onwards(None, before, power)
        if between is None or not self._is_sharp(between):
            return ""
        return between.growth_in_words(known)

    def _is_sharp(self, stage: Stage) -> bool:
        # Without the map the interior point method has found it, which is sharp.
        sharp = _EVIDENCE * self._task.settings.friction_tolerance
        return self._vectors is None or self._arrives(stage, stage.target, sharp)

    def _stages(self) -> Iterator[Stage]:
        before: Stage | None = None
        known = self._from_nothing(min(_SOFTEST, self._last - 1.0))
        step = _LONGEST
        while known is not None:
            yield known
            if known.power >= self._last or self.counts.tangents > self._most_tangents:
                return
            found = None
            while found is None and step >= _SHORTEST and self._vectors is not None:
                found = self._onwards(before, known, min(known.power + step, self._last))
                step = 0.5 * step if found is None else min(_LONGER * step, _LONGEST)
            if found is None:
                # Where the solutions turn back others may lead on.
                step = _LONGEST
                power = min(known.power + step, self._last)
                found = self._from_nothing(power) or self._from_less_friction(power)
            before, known = known, found

    def _arrives(self, stage: Stage, target: Target, tolerance: float) -> bool:
        """Whether Newton's method leads from a stage to a solution that is so sharp."""
        if self._solved(target, stage.bounds, tolerance) is None:
            return False
        change = self.found.friction_change
        assert change is not None
        try:
            if change > tolerance:
                self.found = settled_from(self._task.aside(self.counts, target), self.found)
            return True
        except NotConverged:
            return False

    def _onwards(self, before: Stage | None, known: Stage, power: float) -> Stage | None:
        target, before_it = _softened(self._task.target, power), self.found
        start = known.foreseen(before, power)
        bounds = self._solved(target, start, _ROUGH)
        if bounds is None:
            self.found = before_it
            return None
        force = contact_force(self._task.system, self.found)
        return Stage(power, target, bounds, force)

    def _solved(self, target: Target, start: FloatArray, tolerance: float) -> FloatArray | None:
        problem = BoundMap(sharpened(self._task.aside(self.counts, target)), self.found.last)
        newton = MapNewton(problem, tolerance, _FEW)
        try:
            found = newton.solve(start)
        finally:
            problem.destroy()
        self.found = replace(problem.found, friction_change=newton.left)
        return found

    def _from_nothing(self, power: float) -> Stage | None:
        system, target = self._task.system, _softened(self._task.target, power)
        solver = InteriorPoint(self._task.aside(self.counts, target))
        try:
            for approach in solver.approaches:
                solver.approach = approach
                system.u.x.array[:] = 0.0
                system.constraints.apply(system.u)
                with contextlib.suppress(NotConverged):
                    self.found = solver.solve()
                    return self._stage(power, target)
            return None
        finally:
            solver.destroy()

    def _from_less_friction(self, power: float) -> Stage | None:
        target = _softened(self._task.target, power)
        left = self._most_tangents - self.counts.tangents
        with contextlib.suppress(NotConverged):
            self.found, folds = solve_on_branch(self._task.aside(self.counts, target), left)
            self.folds += folds
            return self._stage(power, target)
        return None

    def _stage(self, power: float, target: Target) -> Stage:
        """The stage of the solution in the system; collective."""
        force = contact_force(self._task.system, self.found)
        bounds = np.empty(0) if self._vectors is None else self._vectors.in_force()
        return Stage(power, target, bounds, force)


def _softened(target: Target, power: float) -> Target:
    """The target with penalties no stiffer than a power of ten times the stiffness.

    Friction is regularised as the penalty of contact would do it.  The numbers have three
    digits, so that a message can give them.
    """
    penalty = target.penalty
    n = min(penalty.n, _rounded(10.0**power * target.stiffness))
    epsilon = max(penalty.epsilon, _rounded(target.length / (10.0**power * target.stiffness)))
    least = _rounded(epsilon * target.young)
    lengths = tuple(max(length, least) for length in penalty.regularisations)
    return replace(target, penalty=Penalty(n, epsilon, lengths))


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


def rescue(task: Task, report: SolverReport, most_tangents: int) -> Rescue:
    """The solution that stiffer and stiffer penalties lead to, or the branch over friction.

    Where forces grow with the penalty, that is the explanation.  Collective.
    """
    stiffened = None
    if task.system.rubbing and not task.system.held_by_friction:
        stiffened = Stiffening(task, most_tangents).tried()
    if stiffened is not None and stiffened.growth:
        known, reason = vars(stiffened.found), report.reason + stiffened.growth
        report = replace(report, **known, reason=reason, suggestion=_WEDGED_WAY_OUT)
        return Rescue(report, is_explained=True)
    try:
        if stiffened is not None:
            found, folds = stiffened.found, stiffened.folds
        elif task.follows_branch:
            found, folds = solve_on_branch(task, most_tangents)
        else:
            return Rescue(report)
        past = (
            "with less friction there are several solutions: the branch of solutions over the "
            f"share of friction.coefficient turns {folds} times before this one, so there may be "
            "others here as well"
        )
        return Rescue(report, found, [past] if folds else [])
    except NotConverged as end:
        reason = "; ".join(filter(None, (report.reason, str(end))))
        return Rescue(replace(report, reason=reason))


def contact_force(system: PenalisedSystem, found: Outcome) -> float:
    """The sum of all pressures; collective."""
    assert found.multipliers is not None
    pairs = zip(system.contacts, found.multipliers.contacts, strict=True)
    return sum(float(item.surface.integral(forces.pressure)) for item, forces in pairs)


def _force_with_little_friction(task: Task) -> float | None:
    """The sum of all pressures with next to no friction, None if not solved; collective."""
    system, tries = task.system, Counts()
    with system.preserved():
        system.u.x.array[:] = 0.0
        system.constraints.apply(system.u)
        solver = InteriorPoint(task.aside(tries), share=_LITTLE)
        try:
            return contact_force(system, solver.solve())
        except NotConverged:
            return None
        finally:
            solver.destroy()
            task.counts.add(tries)
