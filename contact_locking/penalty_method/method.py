"""The method of the paper: continuation in n, the fixed point of the bound, and SNES on (26)."""

from __future__ import annotations

from dataclasses import replace

from contact_locking.errors import NotConverged
from contact_locking.laws.penalty import Penalty
from contact_locking.penalty_method.continuation import PenaltyPath, follow
from contact_locking.penalty_method.equations import Equations
from contact_locking.penalty_method.fixed_point import fixed_point
from contact_locking.penalty_method.newton import Newton
from contact_locking.solver.explain import BOUND_WAY_OUT
from contact_locking.solver.task import Outcome, SavedState, Task, stage_of

# Stages before the last only have to be good starting points.
_INTERMEDIATE_TOLERANCE = 1e-2
# (26) is solved more sharply than the last change of the friction bound by the first factor, at the
# first bound to the second one, and no more sharply than the tolerance by the third.
_SHARE_OF_CHANGE, _FIRST, _SHARPEST = 1e-2, 1e-3, 0.1

_WAY_OUT = "Try solver.method: auto, lower penalty.n or raise penalty.epsilon."


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
        try:
            outcome = _along(path, task, equations, stages)
            return replace(outcome.with_counts(task.counts, stages), from_saved=True)
        except NotConverged:
            task.system.clear()
            stages.clear()
    try:
        outcome = _along(PenaltyPath.towards(task.target), task, equations, stages)
    except NotConverged as failure:
        way_out = f"{_WAY_OUT}  {BOUND_WAY_OUT}" if task.system.rubbing else _WAY_OUT
        outcome = Outcome(equations.multipliers(), reason=str(failure), suggestion=way_out)
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
    newton.solve(tolerance)
    return Outcome.solved(equations.multipliers(), friction_change=change, contraction=contraction)
