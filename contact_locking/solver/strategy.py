"""The entry point to the general solver: attempts in order, and an explanation if all fail."""

from __future__ import annotations

from dataclasses import replace

from contact_locking.errors import Infeasible, NotConverged
from contact_locking.findings import Finding
from contact_locking.solver.explain import Reasons
from contact_locking.solver.interior_point.method import InteriorPoint
from contact_locking.solver.interior_point.tuning import CLOSE, WIDE, Approach
from contact_locking.solver.ksp import LinearFailure, is_direct
from contact_locking.solver.task import Outcome, SavedState, Task, stage_of

# Each attempt starts at the elastic displacement and is finished by the pieces of the laws.  The
# first also tries the pieces before the interior point method, from a saved state and from that
# displacement.  docs/notes/ladder.md counts the random problems that each attempt solves.
LADDER = (CLOSE, WIDE)


def solve(task: Task, saved: SavedState | None = None) -> Outcome:
    """Solve the system of ``task`` for the penalty of its target; collective.

    The solve tries the state ``saved`` first; the outcome's ``from_saved`` says whether that led to
    the solution.  If the iterative linear solver fails on a problem for which auto is direct, the
    attempt is repeated with the direct one.
    """
    penalty, reasons = task.target.penalty, Reasons(task)
    task.monitor.stage(1, 1, penalty.n, penalty.epsilon)
    # Without friction all attempts would be the same.
    warnings, attempts = list[Finding](), list(LADDER if task.system.rubbing else LADDER[:1])
    while not (outcome := _attempt(attempts[0], task, saved)).converged:
        saved = None
        if outcome.failure == LinearFailure.code and _may_factorise(task):
            task = task.with_settings(linear="direct")
            warnings.append(Finding("solver.factorised"))
        elif len(attempts) > 1 and reasons.may_have_solution(outcome):
            del attempts[0]
        else:
            outcome = reasons.explain(outcome)
            break
    stages = [stage_of(penalty, task.counts.tangents)]
    outcome = replace(outcome.with_counts(task.counts, stages), warnings=warnings)
    task.system.tools.rest(task.system.u)
    task.monitor.counted(outcome.tangents, outcome.updates)
    return outcome


def _attempt(approach: Approach, task: Task, saved: SavedState | None) -> Outcome:
    """The outcome of one attempt, finished by the pieces of the laws; collective.

    The solver is destroyed before the next attempt, because it takes much memory.
    """
    system, solver = task.system, InteriorPoint(task, approach)
    system.u.x.array[:] = system.constraints.held_part(system.u.x.array)
    try:
        return solver.finish(solver.solve(solver.state_of(saved)))
    except NotConverged as failure:
        return (None if isinstance(failure, Infeasible) else solver.rescue()) or Outcome(
            solver.multipliers(),
            friction_change=solver.friction_change,
            failure=failure.code,
            reason=str(failure),
        )
    finally:
        solver.destroy()


def _may_factorise(task: Task) -> bool:
    """Whether the settings say iterative, auto would be direct, and no PETSc options are set."""
    settings, dim, size = task.settings, task.system.dim, task.system.size
    is_small = is_direct("auto", dim, size) and not is_direct(settings.linear, dim, size)
    return is_small and not settings.petsc
