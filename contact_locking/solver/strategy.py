"""The nonlinear strategies by name, and the one entry point to them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from contact_locking import wings
from contact_locking.errors import Infeasible, InputError, NotConverged
from contact_locking.parallel import maximum
from contact_locking.solver.interior_point.feasibility import Verdict, judge
from contact_locking.solver.interior_point.method import InteriorPoint
from contact_locking.solver.linear.ksp import LINEAR_FAILURE, is_direct
from contact_locking.solver.task import (
    Outcome,
    SavedState,
    SolverReport,
    Task,
    stage_of,
)

# What wings try after a failure may take so many times the tangents of the solve that fails, or so
# many where that fails at once.
_TIMES, _AT_LEAST = 16, 1000
_FACTORISED = (
    "the iterative solver of solver.linear did not converge; the direct solver took its place"
)
_MORE_ITERATIONS = "Raise solver.max_iterations if it was low."
_BOUND_WAY_OUT = (
    "If the friction bound does not settle, lower friction.coefficient or enlarge "
    "friction.smoothing.radius."
)
# Less friction is no help for a body that friction holds.
_HELD_BY_FRICTION = (
    "Friction alone holds the body: if the loads need all of the friction there is, press the body "
    "more, raise friction.coefficient, or hold the body by loads.displacements.  If the friction "
    "bound does not settle, enlarge friction.smoothing.radius."
)
_VERGE_WAY_OUT = (
    "If the strain limit only just admits the prescribed displacements and the gap, as round "
    "numbers may be chosen, change one of them by 0.1 %: then there is a solution, or a proof that "
    "there is none."
)


def interior_point(task: Task, saved: SavedState | None = None) -> SolverReport:
    """Solve by the pieces of the laws from a saved state, and by the interior point method."""
    penalty, proofs = task.target.penalty, Proofs(task)
    task.monitor.stage(1, 1, penalty.n, penalty.epsilon)
    attempt = _attempted(task, saved, proofs.leave_hope)
    if attempt.failure is not None:
        return _by_other_ways(task, attempt, attempt.failure, proofs)
    return _solved(task, attempt.found, attempt.warnings, attempt.from_saved)


@dataclass(frozen=True)
class Rescue:
    """What is found after a failure: a solution, or what the report says of it.

    ``is_explained`` says that the report has the cause of the failure.
    """

    report: SolverReport
    found: Outcome | None = None
    warnings: Sequence[str] = ()
    is_explained: bool = False


class Proofs:
    """The proofs that a problem has no solution, each computed when it is first asked for."""

    def __init__(self, task: Task) -> None:
        self._task = task

    @functools.cached_property
    def is_unbalanced(self) -> bool:
        """Whether no forces of contact and friction balance the loads; collective."""
        return self._task.is_unbalanced()

    @functools.cached_property
    def verdict(self) -> Verdict | None:
        """Whether anything is admissible; collective."""
        return judge(self._task)

    def leave_hope(self, failure: NotConverged) -> bool:
        """Whether there may be a solution after a failure; collective."""
        if isinstance(failure, Infeasible) or self.is_unbalanced or not self._task.searches:
            return False
        # Penalised problems have solutions where nothing is admissible.
        return not self._task.target.penalty.is_strict or self.verdict is None


def _solved(
    task: Task, found: Outcome, warnings: Sequence[str] = (), from_saved: bool = False
) -> SolverReport:
    stages = [stage_of(task.target.penalty, task.counts.tangents)]
    return SolverReport.solved(
        found, task.counts, stages=stages, warnings=warnings, from_saved=from_saved
    )


def _by_other_ways(
    task: Task, attempt: Attempt, failure: NotConverged, proofs: Proofs
) -> SolverReport:
    """What a wing finds after a failure, or why there is no solution."""
    report = SolverReport(
        **vars(attempt.found),
        is_infeasible=isinstance(failure, Infeasible),
        is_unbalanced=proofs.is_unbalanced,
        reason=str(failure),
        suggestion=_interior_way_out(task),
        warnings=attempt.warnings,
    )
    if report.is_unbalanced:
        return _ended(report, task)
    if proofs.leave_hope(failure):
        most = max(_AT_LEAST, _TIMES * task.counts.tangents)
        for rescue in wings.RESCUES:
            other = rescue(task, report, most)
            if other.found is not None:
                return _solved(task, other.found, [*attempt.warnings, *other.warnings])
            report = other.report
            if other.is_explained:
                return _ended(report, task)
    if (verdict := proofs.verdict) is not None:
        report = replace(
            report,
            is_infeasible=task.target.penalty.is_strict,
            reason=verdict.reason,
            suggestion=verdict.way_out,
            admissible_factor=verdict.factor,
        )
    return _ended(report, task)


def _ended(report: SolverReport, task: Task) -> SolverReport:
    """The report of a failure with what all ways together took."""
    stages = [stage_of(task.target.penalty, task.counts.tangents)]
    return replace(report, **vars(task.counts), stages=stages)


@dataclass(frozen=True)
class Attempt:
    """What a solver has found, or has reached before a failure; ``warnings`` are about the way."""

    found: Outcome
    failure: NotConverged | None = None
    from_saved: bool = False
    warnings: Sequence[str] = ()


def _attempted(
    task: Task, saved: SavedState | None, goes_on: Callable[[NotConverged], bool]
) -> Attempt:
    """A solve by one approach after the other, as long as one ``goes_on`` after a failure.

    No two solvers are there at a time, nor beside what ``goes_on`` solves, as each takes much
    memory.  An approach that an iterative solver ends goes again with a direct one, if auto would
    have taken that.  ``saved`` is where the first solve goes on from.  Collective.
    """
    failure, warnings = NotConverged(), list[str]()
    number, count = 0, 1
    while number < count and (number == 0 or goes_on(failure)):
        solver = InteriorPoint(task)
        count = len(solver.approaches)
        solver.approach = solver.approaches[number]
        made, saved = replace(_attempt(solver, task, saved), warnings=[*warnings]), None
        if made.failure is None:
            return made
        failure = made.failure
        if str(failure) == LINEAR_FAILURE and _may_factorise(task):
            task = task.with_settings(linear="direct")
            warnings.append(_FACTORISED)
        else:
            number += 1
    return made


def _attempt(solver: InteriorPoint, task: Task, saved: SavedState | None) -> Attempt:
    """What a solver finds, finished by the pieces of the laws; collective."""
    system = task.system
    system.u.x.array[:] = system.constraints.held_part(system.u.x.array)
    try:
        found = solver.solve(solver.iterate_of(saved))
        return Attempt(solver.finish(found), from_saved=solver.from_saved)
    except NotConverged as failure:
        reached = Outcome(solver.multipliers(), friction_change=solver.friction_change)
        return Attempt(reached, failure)
    finally:
        solver.destroy()


def _may_factorise(task: Task) -> bool:
    """Whether auto is direct where the settings are iterative, with no options of the user."""
    settings, dim, size = task.settings, task.system.dim, task.system.size
    is_small = is_direct("auto", dim, size) and not is_direct(settings.linear, dim, size)
    return is_small and not settings.petsc


def _interior_way_out(task: Task) -> str:
    """What may help where the interior point method does not arrive; collective."""
    advice = [_MORE_ITERATIONS, *_friction_way_out(task)]
    inverse_limits = [item.inverse_limit.x.array for item in task.system.data.sets]
    if maximum(task.system.comm, np.concatenate(inverse_limits)) > 0.0:
        advice.append(_VERGE_WAY_OUT)
    return "  ".join(advice)


def _friction_way_out(task: Task) -> list[str]:
    """What may help where the friction bound does not settle; nothing without friction."""
    if not task.system.rubbing:
        return []
    return [_HELD_BY_FRICTION if task.system.held_by_friction else _BOUND_WAY_OUT]


METHODS: Mapping[str, Callable[[Task, SavedState | None], SolverReport]] = {
    "auto": interior_point,
    "interior_point": interior_point,
}


def solve(method: str, task: Task, saved: SavedState | None = None) -> SolverReport:
    """Solve the system of ``task`` for the penalty of its target by the named method; collective.

    ``saved`` is where to go on from if that is any use; ``report.from_saved`` says whether it was.
    Raises InputError for a method there is not.
    """
    if method not in METHODS:
        raise InputError(f"no solver {method!r}; there are: {', '.join(METHODS)}", "solver.method")
    report = METHODS[method](task, saved)
    task.system.tools.rest(task.system.u)
    task.monitor.counted(report.tangents, report.updates)
    return report
