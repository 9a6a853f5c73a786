"""Where the solver fails: solutions over the penalty, and on the branch over friction."""

from __future__ import annotations

from dataclasses import replace

from contact_locking.errors import NotConverged
from contact_locking.solver.strategy import Rescue
from contact_locking.solver.task import SolverReport, Task
from contact_locking.theory.equilibria.search import solve_on_branch
from contact_locking.theory.equilibria.stiffening import solve_by_penalties

_WEDGED_WAY_OUT = (
    "Lower friction.coefficient.  Where friction wedges the body in, the pressure may grow without "
    "a bound, and there may be no equilibrium."
)
_PAST_FOLDS = (
    "with less friction there are several solutions: the branch of solutions over the share of "
    "friction.coefficient turns {folds} times before this one, so there may be others here as well"
)


def rescue(task: Task, report: SolverReport, most_tangents: int) -> Rescue:
    """The solution that stiffer and stiffer penalties lead to, or the branch over friction.

    Where forces grow with the penalty, that is the explanation.  Collective.
    """
    stiffened = solve_by_penalties(task, most_tangents)
    if stiffened is not None and stiffened.growth:
        known, reason = vars(stiffened.found), report.reason + stiffened.growth
        report = replace(report, **known, reason=reason, suggestion=_WEDGED_WAY_OUT)
        return Rescue(report, is_explained=True)
    if stiffened is not None:
        return Rescue(report, stiffened.found, _past(stiffened.folds))
    try:
        if task.follows_branch:
            found, folds = solve_on_branch(task, most_tangents)
            return Rescue(report, found, _past(folds))
    except NotConverged as end:
        reason = "; ".join(filter(None, (report.reason, str(end))))
        report = replace(report, reason=reason)
    return Rescue(report)


def _past(folds: int) -> list[str]:
    """The warning about folds that lie before a solution."""
    return [_PAST_FOLDS.format(folds=folds)] if folds else []
