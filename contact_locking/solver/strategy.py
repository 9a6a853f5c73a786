"""The one entry point to the general solver: its attempts in their order, and why all failed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from contact_locking.errors import Infeasible, NotConverged
from contact_locking.findings import Finding
from contact_locking.solver.explain import Reasons
from contact_locking.solver.interior_point.method import InteriorPoint
from contact_locking.solver.interior_point.tuning import CLOSE, WIDE, Approach
from contact_locking.solver.linear.ksp import LINEAR_FAILURE, is_direct
from contact_locking.solver.task import Outcome, SavedState, Task, stage_of

# Each attempt begins with the elastic displacement.  The first tries the pieces of the laws, from a
# saved state and from that displacement, before the interior point method; all are finished by the
# pieces.  docs/notes/ladder.md has how many random problems each attempt solves.
LADDER = (CLOSE, WIDE)


def solve(task: Task, saved: SavedState | None = None) -> Outcome:
    """Solve the system of ``task`` for the penalty of its target; collective.

    ``saved`` is where to go on from if that is any use; ``from_saved`` of the outcome says whether
    it was.  An attempt that an iterative linear solver ends goes again with a direct one, if auto
    would have taken that.
    """
    penalty, reasons = task.target.penalty, Reasons(task)
    task.monitor.stage(1, 1, penalty.n, penalty.epsilon)
    warnings, attempts = list[Finding](), list(_attempts_of(task))
    while not (outcome := _attempt(attempts[0], task, saved)).converged:
        saved = None
        if outcome.reason == LINEAR_FAILURE and _may_factorise(task):
            task = task.with_settings(linear="direct")
            warnings.append(Finding("solver.factorised"))
        elif len(attempts) > 1 and reasons.leave_hope(outcome):
            del attempts[0]
        else:
            outcome = reasons.explain(outcome)
            break
    stages = [stage_of(penalty, task.counts.tangents)]
    outcome = replace(outcome.with_counts(task.counts, stages), warnings=warnings)
    task.system.tools.rest(task.system.u)
    task.monitor.counted(outcome.tangents, outcome.updates)
    return outcome


def _attempts_of(task: Task) -> Sequence[Approach]:
    """The attempts that differ; without a moving friction bound all are the same."""
    return LADDER if task.system.rubbing else LADDER[:1]


def _attempt(approach: Approach, task: Task, saved: SavedState | None) -> Outcome:
    """What a solver finds, finished by the pieces of the laws; collective.

    No two solvers exist at a time, as each takes much memory.
    """
    system, solver = task.system, InteriorPoint(task, approach)
    system.u.x.array[:] = system.constraints.held_part(system.u.x.array)
    try:
        return solver.finish(solver.solve(solver.state_of(saved)))
    except NotConverged as failure:
        is_infeasible = isinstance(failure, Infeasible)
        return (None if is_infeasible else solver.rescue()) or Outcome(
            solver.multipliers(),
            friction_change=solver.friction_change,
            reason=str(failure),
            is_infeasible=is_infeasible,
        )
    finally:
        solver.destroy()


def _may_factorise(task: Task) -> bool:
    """Whether auto is direct where the settings are iterative, with no options of the user."""
    settings, dim, size = task.settings, task.system.dim, task.system.size
    is_small = is_direct("auto", dim, size) and not is_direct(settings.linear, dim, size)
    return is_small and not settings.petsc
