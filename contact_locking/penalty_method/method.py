"""The method of the paper: continuation in n, the fixed point of the bound, and SNES on (26).

The fixed point is ``G = mu(|u_tau|) |R sigma_nu(u(G))|``.  The map takes a bound G, solves Tresca's
problem, which is friction under the known bound G, and gives the bound of the solution.  The map
Lambda of Lemma 4.7 takes a traction, a vector, in its place; it has the same fixed points but other
contraction factors, and is not defined for delta = 0.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import joint_norm
from contact_locking.errors import NotConverged
from contact_locking.laws.limits import Penalty
from contact_locking.penalty_method.equations import Equations
from contact_locking.penalty_method.newton import Newton
from contact_locking.solver.strategy import BOUND_ADVICE
from contact_locking.solver.task import Outcome, SavedState, Target, Task, stage_of

# The softest penalties: n over the largest eigenvalue of A, and lengths over that of the body.
_SOFT_LOCKING, _SOFT_CONTACT = 10.0, 0.1
# After a failure the step halves; the continuation ends below so many decades.
_SMALLEST = 0.05


@dataclass(frozen=True)
class PenaltyPath:
    """``(n, epsilon, delta)(s)``, 0 <= s <= 1: all geometric, from a soft ``start`` to the ``end``.

    ``decades`` is the longest of the ways in powers of ten.
    """

    start: Penalty
    end: Penalty

    @classmethod
    def towards(cls, target: Target) -> PenaltyPath:
        """From ``n = 10 |A|``, ``epsilon = L/(10 E)`` and ``delta = L/10`` in a body of length L.

        A target that is softer than that is its own start.
        """
        soft = _SOFT_CONTACT * target.length
        count = len(target.penalty.regularisations)
        n, epsilon = _SOFT_LOCKING * target.stiffness, soft / target.young
        return cls.onwards(Penalty(n, epsilon, (soft,) * count), target)

    @classmethod
    def onwards(cls, known: Penalty, target: Target) -> PenaltyPath:
        """From the penalty parameters of a known solution, where the target is beyond them."""
        end = target.penalty
        n, epsilon = min(known.n, end.n), max(known.epsilon, end.epsilon)
        longest = max(known.regularisations, default=0.0)
        return cls(Penalty(n, epsilon, tuple(max(longest, d) for d in end.regularisations)), end)

    @property
    def decades(self) -> float:
        start, end = self._logarithms()
        return float(np.max(np.abs(end - start)))

    def at(self, s: float) -> Penalty:
        start, end = self._logarithms()
        n, epsilon, *deltas = 10.0 ** (start + s * (end - start))
        return self.end if s >= 1.0 else Penalty(float(n), float(epsilon), tuple(deltas))

    def _logarithms(self) -> list[FloatArray]:
        sides = (self.start, self.end)
        return [np.log10([p.n, p.epsilon, *p.regularisations]) for p in sides]


def follow(path: PenaltyPath, solve: Callable[[Penalty, bool], None]) -> None:
    """Call ``solve(penalty, is_last)`` along the path, a decade at a time.

    A stage fails by raising NotConverged and leaves the state that it started from; the step is
    then halved.  The last failure is raised where the step has become small.
    """
    step = 1.0 / max(path.decades, 1.0)
    smallest = _SMALLEST * step
    solved, s = 0.0, 0.0 if path.decades > 0.0 else 1.0
    while True:
        # The rest of the way is at least a fifth of a step.
        s = 1.0 if s > 1.0 - 0.2 * step else s
        penalty = path.at(s)
        try:
            solve(penalty, s >= 1.0)
        except NotConverged as failure:
            step = 0.5 * (s - solved)
            if step < smallest:
                where = f"n = {penalty.n:.3g}, epsilon = {penalty.epsilon:.3g}"
                failure.args = (f"{failure} at {where}",)
                raise
            s = solved + step
            continue
        if s >= 1.0:
            return
        solved, s = s, s + step


def fixed_point(
    task: Task, equations: Equations, solve: Callable[[float], None]
) -> tuple[float, float | None]:
    """Repeat ``G <- mu |R sigma_nu(u(G))|`` until G changes by ``friction_tolerance`` of itself.

    ``solve`` solves (26) under the present bound, more sharply than the last change that it is
    passed, which is infinite at first.  Changes count relative to the norm of the bound, or to
    ``Target.least_bound`` if that is larger.  Afterwards the system holds the bound of the last
    solve.  Ends after ``max_friction_updates`` at the latest.  Returns the last change and the
    geometric mean of the ratios of successive changes, the contraction factor.
    """
    system, target, settings, counts = task.system, task.target, task.settings, task.counts
    bounds, rubbing, changes = system.bounds, system.rubbing, list[float]()
    contraction: float | None = None
    for _ in range(settings.max_friction_updates):
        solve(changes[-1] if changes else math.inf)
        used, new = bounds.at(rubbing), equations.friction_bounds()
        displacement, tolerance = system.largest_displacement(), settings.tolerance
        strain = target.mean_strain(system.energy(), displacement, tolerance)
        size = max(joint_norm(rubbing, new), target.least_bound(strain))
        change = joint_norm(rubbing, [b - a for a, b in zip(used, new, strict=True)])
        changes.append(change / size if size > 0.0 else change)
        counts.updates += 1
        contraction = contraction_factor(changes, settings.friction_tolerance) or contraction
        task.monitor.friction_update(counts.updates, changes[-1], contraction)
        if changes[-1] <= settings.friction_tolerance:
            break
        bounds.set(rubbing, new)
    return changes[-1], contraction


def contraction_factor(changes: list[float], floor: float) -> float | None:
    """The geometric mean ratio of successive changes, without those that are far below ``floor``.

    The first change is left out too if there are enough: it measures the start, not the map.
    """
    seen = [change for change in changes if change > 0.1 * floor]
    seen = seen[1:] if len(seen) > 3 else seen
    if len(seen) < 2:
        return None
    return float(np.exp(np.mean(np.log(np.divide(seen[1:], seen[:-1])))))


# Stages before the last only have to be good starting points.
_INTERMEDIATE_TOLERANCE = 1e-2
# (26) is solved more sharply than the last change of the friction bound by the first factor, at the
# first bound to the second one, and no more sharply than the tolerance by the third.
_SHARE_OF_CHANGE, _FIRST, _SHARPEST = 1e-2, 1e-3, 0.1

_ADVICE = "Try solver.method: auto, lower penalty.n or raise penalty.epsilon."


def solve(task: Task, saved: SavedState | None = None) -> Outcome:
    """Solve (26) with the fixed point of its friction bound; collective.

    From a saved state it starts with the penalties of that state; where this fails, from nothing.
    """
    equations = Equations(task.system)
    stages: list[dict[str, float | int]] = []
    if saved is not None and saved.multipliers is not None:
        system = task.system
        system.u.x.array[:] = saved.displacement
        system.constraints.apply(system.u)
        for contact, forces in zip(system.contacts, saved.multipliers.contacts, strict=True):
            system.bounds[contact] = contact.friction_bound(system.u, forces.pressure)
        path = PenaltyPath.onwards(saved.penalty, task.target)
        with contextlib.suppress(NotConverged):
            outcome = _along(path, task, equations, stages)
            if outcome.converged:
                return replace(outcome.with_counts(task.counts, stages), from_saved=True)
        system.clear()
        stages.clear()
    try:
        outcome = _along(PenaltyPath.towards(task.target), task, equations, stages)
    except NotConverged as failure:
        advice = f"{_ADVICE}  {BOUND_ADVICE}" if task.system.rubbing else _ADVICE
        outcome = Outcome(
            equations.multipliers(), failure=failure.code, reason=str(failure), suggestion=advice
        )
    return outcome.with_counts(task.counts, stages)


def _along(
    path: PenaltyPath, task: Task, equations: Equations, stages: list[dict[str, float | int]]
) -> Outcome:
    """The solution at the end of a path; adds to ``stages``; raises NotConverged; collective."""
    newton, counts, system, outcome = Newton(task, equations), task.counts, task.system, Outcome()

    def solve_stage(penalty: Penalty, is_last: bool) -> None:
        nonlocal outcome
        equations.set_penalty(penalty)
        task.monitor.stage(len(stages) + 1, round(path.decades) + 1, penalty.n, penalty.epsilon)
        before = counts.tangents
        if is_last:
            outcome = _settled(newton, task, equations)
        else:
            newton.solve(_INTERMEDIATE_TOLERANCE)
            system.bounds.set(system.rubbing, equations.friction_bounds())
            counts.updates += bool(system.rubbing)
        stages.append(stage_of(penalty, counts.tangents - before))
        task.monitor.counted(counts.tangents, counts.updates)

    try:
        follow(path, solve_stage)
        return outcome
    finally:
        newton.destroy()


def _settled(newton: Newton, task: Task, equations: Equations) -> Outcome:
    """(26) solved to the tolerances, with the fixed point of the bound if there is friction.

    Each bound takes a step at least, and its solve is only as sharp as the bound is known.
    """
    tolerance = task.settings.tolerance
    change = contraction = None

    def solve_tresca(change: float) -> None:
        sharpness = min(_SHARE_OF_CHANGE * change, _FIRST)
        newton.solve(max(_SHARPEST * tolerance, sharpness), least_steps=1)

    if task.system.rubbing:
        change, contraction = fixed_point(task, equations, solve_tresca)
        if change > task.settings.friction_tolerance:
            why = f"the friction bound still changes by {change:.1e} of itself"
            failed = Outcome(equations.multipliers(), None, None, change, contraction)
            return replace(failed, failure=NotConverged.code, reason=why, suggestion=BOUND_ADVICE)
    newton.solve(tolerance)
    return Outcome.solved(equations.multipliers(), friction_change=change, contraction=contraction)
