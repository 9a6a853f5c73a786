"""The nonlinear strategies by name, and the one entry point to them."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.errors import Infeasible, InputError, NotConverged
from contact_locking.laws.penalty import Penalty
from contact_locking.parallel import maximum
from contact_locking.solver.equilibria.search import solve_on_branch
from contact_locking.solver.equilibria.stiffening import Way, solve_by_penalties
from contact_locking.solver.fixed_point import fixed_point
from contact_locking.solver.interior_point import InteriorPoint, explain_by_friction, is_impossible
from contact_locking.solver.last_iterate import LastIterate
from contact_locking.solver.linear.ksp import LINEAR_FAILURE, is_direct
from contact_locking.solver.newton import NewtonSolver
from contact_locking.solver.polish import has_digits, is_in_reach, polish, settle, step_on
from contact_locking.solver.task import SavedState, SolverReport, Target, Task


@dataclass(frozen=True)
class PenaltyPath:
    """``(n, eps, delta)(s)`` for s in [0, 1], all geometric, from a soft ``start`` to the ``end``.

    ``delta`` is the regularisation of friction.  ``decades`` is the longest of the ways in powers
    of ten.
    """

    start: Penalty
    end: Penalty

    @classmethod
    def towards(cls, target: Target) -> PenaltyPath:
        """From ``n = 10 stiffness``, ``eps = length/(10 E)`` and ``delta = length/10``.

        A target that is softer than that is its own start.
        """
        soft = 0.1 * target.length
        count = len(target.penalty.regularisations)
        start = Penalty(10.0 * target.stiffness, soft / target.young, (soft,) * count)
        return cls.onwards(start, target)

    @classmethod
    def onwards(cls, known: Penalty, target: Target) -> PenaltyPath:
        """From the penalty parameters of a known solution, where the target is beyond them.

        Of a solution with another number of contacts the largest regularisation counts.
        """
        end, smooth = target.penalty, known.regularisations
        if len(smooth) != len(end.regularisations):
            smooth = (max(smooth, default=0.0),) * len(end.regularisations)
        pairs = zip(smooth, end.regularisations, strict=True)
        n, epsilon = min(known.n, end.n), max(known.epsilon, end.epsilon)
        return cls(Penalty(n, epsilon, tuple(max(pair) for pair in pairs)), end)

    @property
    def decades(self) -> float:
        return max(abs(math.log10(end / start)) for start, end in self._ways())

    def at(self, s: float) -> Penalty:
        if s >= 1.0:
            return self.end
        n, epsilon, *regularisations = (start * (end / start) ** s for start, end in self._ways())
        return Penalty(n, epsilon, tuple(regularisations))

    def _ways(self) -> list[tuple[float, float]]:
        """Start and end of each parameter."""
        sides = ((p.n, p.epsilon, *p.regularisations) for p in (self.start, self.end))
        return list(zip(*sides, strict=True))


def follow(
    path: PenaltyPath, stage: Callable[[Penalty, bool], None], smallest: float = 0.05
) -> None:
    """Call ``stage(penalty, last)`` along the path, a decade at a time, halving after a failure.

    A stage fails by raising NotConverged and must leave the state it started from.  The failure
    is passed on once the step has shrunk to ``smallest`` decades.  A path of no length has one
    stage, the last.
    """
    if path.decades == 0.0:
        stage(path.end, True)
        return
    step = 1.0 / max(path.decades, 1.0)
    limit = smallest * step
    done, target = 0.0, 0.0
    while True:
        # A remainder of less than a fifth of a step is not worth a stage of its own.
        target = 1.0 if target > 1.0 - 0.2 * step else target
        penalty = path.at(target)
        try:
            stage(penalty, target >= 1.0)
        except NotConverged as failure:
            step = 0.5 * (target - done)
            if step < limit:
                where = f"n = {penalty.n:.3g}, epsilon = {penalty.epsilon:.3g}"
                raise NotConverged(f"{failure} at {where}") from None
            target = done + step
            continue
        if target >= 1.0:
            return
        done, target = target, target + step


# Stages before the last only have to be good starting points.
_INTERMEDIATE_TOLERANCE = 1e-2
# Newton's steps from where the interior point method arrived.
_POLISH = 4
# Newton's steps from where the interior point method stopped early.
_RESCUE = 30
# Solves with a known friction bound are as sharp as a share of its last change, so that their
# errors do not pass for its contraction, and so sharp at least.
_SHARE_OF_CHANGE, _LOOSEST = 1e-4, 1e-3
# The solutions over the penalty, and then the branch over the share of friction, may take so many
# times the tangents of the solve that fails, or so many where that fails at once.
_TIMES, _AT_LEAST = 12, 1000
# From a saved state Newton either arrives within so many steps and updates of the bound, or takes
# more tangents than the interior point method needs from nothing.  Where it is that near, the
# relative residual at the start is below the last of these numbers.
_FEW_STEPS, _FEW_UPDATES, _NEAR = 6, 12, 0.1

_NEWTON_WAY_OUT = "Try solver.method: interior_point, lower penalty.n or raise penalty.epsilon."
_NOT_NESTED = (
    "solver.friction: nested does not arrive ({reason}); the solution is that of inside, which "
    "needs no contraction"
)
_FACTORISED = (
    "the iterative solver of solver.linear did not converge; the direct solver took its place"
)
_PAST_FOLDS = (
    "with less friction there are several solutions: the branch of solutions over the share of "
    "friction.coefficient turns {folds} times before this one, so there may be others here as well"
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
# The limit of large coefficients: such a node has a traction beside no pressure, and slides.
_NO_SLIP_WAY_OUT = (
    "Without slip, a node where the bodies part may press if it slides and open if it sticks, so "
    "that neither is a solution; take friction.coefficient: 1e3 in place of .inf, with which such "
    "a node slides a little."
)
_VERGE_WAY_OUT = (
    "If the strain limit only just admits the prescribed displacements and the gap, as round "
    "numbers may be chosen, change one of them by 0.1 %: then there is a solution, or a proof that "
    "there is none."
)


def newton_with_continuation(task: Task, saved: SavedState | None = None) -> SolverReport:
    """SNES with the penalty made stiffer stage by stage and the friction bound updated outside.

    From a saved state it goes on with the penalties of that state; where this fails, from nothing.
    """
    report = task.report
    report.suggestion = "  ".join([_NEWTON_WAY_OUT, *_friction_way_out(task)])
    if saved is not None:
        saved.enter(task.system)
        cautious = task.with_settings(max_iterations=min(_RESCUE, task.settings.max_iterations))
        try:
            _follow(PenaltyPath.onwards(saved.penalty, task.target), cautious)
            report.from_saved = True
            return task.succeed()
        except NotConverged:
            _forget(task)
    if task.system.held_by_friction:
        # Without a bound nothing would hold the body while its pressure is sought.
        task.system.hold(task.target.young)
    try:
        _follow(PenaltyPath.towards(task.target), task)
    except NotConverged as failure:
        report.reason = str(failure)
        return report
    return task.succeed()


def _follow(path: PenaltyPath, task: Task) -> None:
    """Newton's method along a path of penalties; raises NotConverged, the last stage in place."""
    newton, report = NewtonSolver(task), task.report

    def stage(penalty: Penalty, last: bool) -> None:
        task.system.set_penalty(penalty)
        index, estimate = len(report.stages) + 1, round(path.decades) + 1
        task.monitor.stage(index, estimate, penalty.n, penalty.epsilon)
        before = report.tangents
        if last:
            settle(newton, task)
        else:
            newton.solve(_INTERMEDIATE_TOLERANCE)
            task.system.update_bounds()
            report.friction += bool(task.system.rubbing)
        task.add_stage(penalty, report.tangents - before)

    try:
        follow(path, stage)
    finally:
        newton.destroy()


def interior_point(task: Task, saved: SavedState | None = None) -> SolverReport:
    """Solve by the interior point method; for a finite n Newton's method polishes the solution.

    The interior point method starts from nothing.  Where Newton's method arrives from the saved
    state, the interior point method is not run.
    """
    report, penalty = task.report, task.target.penalty
    report.suggestion = _interior_way_out(task)
    task.monitor.stage(1, 1, penalty.n, penalty.epsilon)
    if saved is not None and _newton_from(saved, task):
        task.add_stage(penalty, report.tangents)
        report.from_saved = True
        return task.succeed()
    nested, told = task.system.rubbing if task.settings.nested else (), ""

    @functools.cache
    def nothing_is_admissible() -> bool:
        return is_impossible(task)

    def is_unbalanced() -> bool:
        report.is_unbalanced = report.is_unbalanced or task.is_unbalanced()
        return report.is_unbalanced

    def goes_on() -> bool:
        if report.is_infeasible or is_unbalanced():
            return False
        # Penalised problems have solutions where nothing is admissible.
        return not (penalty.is_strict and nothing_is_admissible())

    with contextlib.closing(_approaches(task, bool(nested), goes_on)) as solvers:
        for solver in solvers:
            standing = [item for item in task.system.rubbing if item.friction.stands]
            last, saved = None if saved is None else saved.last, None
            _solve_by(solver, standing if solver.bound_moves else nested, task, last)
            if report.reason:
                if not solver.bound_moves:
                    told = _NOT_NESTED.format(reason=report.reason)
                continue
            if nested and solver.bound_moves:
                report.warnings.append(told)
            task.add_stage(penalty, report.tangents)
            report.from_saved = solver.from_last
            # Newton's last steps want a linear solver as sharp as they are.
            direct = None if solver.is_elastic else solver.direct
            if direct is not None and is_in_reach(task):
                polish(task, _POLISH, direct)
            return task.succeed()
    task.add_stage(penalty, report.tangents)
    if is_unbalanced():
        return report
    if polish(task, _RESCUE, near=False):
        return task.succeed()
    if goes_on():
        most = max(_AT_LEAST, _TIMES * report.tangents)
        way = solve_by_penalties(task, most)
        if way is not Way.LOST:
            return task.succeed() if way is Way.SOLVED else report
        if task.follows_branch and (folds := solve_on_branch(task, most)) is not None:
            report.warnings += [_PAST_FOLDS.format(folds=folds)] if folds else []
            return task.succeed()
    if not nothing_is_admissible():
        explain_by_friction(task)
    return report


def _approaches(task: Task, nests: bool, goes_on: Callable[[], bool]) -> Generator[InteriorPoint]:
    """A solver for each approach, as long as ``goes_on`` after the one before; collective.

    Where friction bounds are to be fixed points of whole solves, a solver that keeps them comes
    first.  No two solvers are there at a time, nor beside what ``goes_on`` solves, as each takes
    much memory.  An approach that an iterative solver ends goes again with a direct one, if auto
    would have taken that.
    """
    if nests:
        solver = InteriorPoint(task, bound_moves=False)
        try:
            yield solver
        finally:
            solver.destroy()
        if task.report.is_infeasible:
            return
    number, count = 0, 1
    while number < count and (number == 0 or goes_on()):
        solver = InteriorPoint(task)
        count = len(solver.approaches)
        solver.approach = solver.approaches[number]
        try:
            yield solver
        finally:
            solver.destroy()
        if task.report.reason == LINEAR_FAILURE and _may_factorise(task):
            task = task.with_settings(linear="direct")
            task.report.warnings.append(_FACTORISED)
        else:
            number += 1


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
    if any(contact.friction.stands for contact in task.system.rubbing):
        return [_NO_SLIP_WAY_OUT]
    return [_HELD_BY_FRICTION if task.system.held_by_friction else _BOUND_WAY_OUT]


def _solve_by(
    solver: InteriorPoint, nested: Sequence[NodalContact], task: Task, last: LastIterate | None
) -> None:
    """Solve once, or for each value of ``nested`` bounds; a failure is written into the report.

    ``last`` is the solution of the step before, if there is one.  Where all bounds are nested, a
    solve goes on from the one before, and is as sharp as the bounds are known.
    """
    system, report, tolerance = task.system, task.report, task.settings.tolerance
    start = system.constraints.held_part(system.u.x.array)
    report.reason, report.multipliers, report.last = "", None, None

    def enough(change: float) -> float:
        """The multiple of the tolerances that is enough after a change of the bounds."""
        if not nested or solver.bound_moves:
            return 1.0
        return max(min(_SHARE_OF_CHANGE * change, _LOOSEST) / tolerance, 1.0)

    def solve(change: float, nothing_slips: bool = False) -> bool:
        loosened = enough(change)
        if solver.can_go_on:
            with contextlib.suppress(NotConverged):
                report.multipliers = solver.solve_on(loosened)
                return loosened == 1.0
        system.u.x.array[:] = start
        report.multipliers = solver.solve(last, nothing_slips, loosened)
        return loosened == 1.0

    def wanted() -> list[FloatArray]:
        assert report.multipliers is not None
        pairs = zip(system.contacts, report.multipliers.contacts, strict=True)
        return [
            contact.friction_bound(system.u, forces.pressure)
            for contact, forces in pairs
            if contact in nested
        ]

    try:
        # Nothing slips at first, also where the body turns out not to be pressed.
        solve(math.inf, nothing_slips=True)
        if nested:
            system.bounds.enter(nested, wanted())
            fixed_point(task, solve, wanted, nested)
    except NotConverged as failure:
        report.multipliers, report.last = report.multipliers or solver.multipliers(), None
        report.reason, report.is_infeasible = str(failure), isinstance(failure, Infeasible)


def _newton_from(saved: SavedState, task: Task) -> bool:
    """Whether Newton's method arrives from the saved state; if not, the system is cleared."""
    system, settings = task.system, task.settings
    if is_direct(settings.linear, system.dim, system.size) and has_digits(task.target):
        if saved.slips and system.rubbing and step_on(saved, task):
            return True
        saved.enter(system)
        task.system.set_penalty(task.target.penalty)
        if system.relative_residual(settings.tolerance) <= _NEAR:
            updates = min(_FEW_UPDATES, settings.max_friction_updates)
            if polish(task.with_settings(max_friction_updates=updates), _FEW_STEPS):
                return True
    _forget(task)
    return False


def _forget(task: Task) -> None:
    """Clear the system after a try from a saved state; the report keeps the counts of the try."""
    task.system.clear()
    task.report.stages.clear()
    task.report.friction_change = task.report.contraction = None


METHODS: Mapping[str, Callable[[Task, SavedState | None], SolverReport]] = {
    "auto": interior_point,
    "interior_point": interior_point,
    "newton": newton_with_continuation,
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
    if len(report.stages) == 1:
        # The steps by which Newton's method polishes belong to the only stage too.
        report.stages[0]["tangents"] = report.tangents
    task.monitor.counted(report.tangents, report.friction)
    return report
