"""The nonlinear strategies by name, and the one entry point to them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from contact_locking.contacts import FrictionBound
from contact_locking.errors import Infeasible, InputError, NotConverged
from contact_locking.progress import Monitor
from contact_locking.solver.continuation import Penalties, PenaltyPath, follow
from contact_locking.solver.feasibility import judge, share_of_friction
from contact_locking.solver.friction import fixed_point
from contact_locking.solver.interior_point import APPROACHES, InteriorPoint
from contact_locking.solver.linear import is_direct
from contact_locking.solver.newton import NewtonSolver
from contact_locking.solver.report import Settings, SolverReport
from contact_locking.solver.saved import SavedState
from contact_locking.solver.target import Target
from contact_locking.system import PenalisedSystem

# Stages before the last only have to be good starting points.
_INTERMEDIATE_TOLERANCE = 1e-2
# The last digits of the friction bound need an equilibrium that is sharper than the bound.
_INNER_SHARE = 0.1
# Newton's convergence radius shrinks like n^-1/2: beyond these values of n/stiffness and
# length/epsilon an interior point solution is too far for it, and where a few steps do not
# arrive, many do not.
_POLISHED_UP_TO = 1e7
_POLISH = 4
# Newton's steps from where the interior point method stopped early.
_RESCUE = 30
# From a saved state Newton either arrives within so many steps and updates of the bound, or takes
# more tangents than the interior point method needs from nothing.  Where it is that near, the
# relative residual at the start is below the last of these numbers.
_FEW_STEPS, _FEW_UPDATES, _NEAR = 6, 12, 0.1

_NEWTON_WAY_OUT = (
    "Try solver.method: interior_point, lower penalty.n or raise penalty.epsilon; if the friction "
    "bound does not settle, lower friction.coefficient or enlarge friction.smoothing.radius."
)
_INFEASIBLE_WAY_OUT = (
    "Refine the mesh, lower the prescribed displacements, raise material.locking_limit or move the "
    "foundation away; a soft penalty.n has a solution that exceeds the limit."
)
_FRICTION_WAY_OUT = (
    "Lower friction.coefficient.  Where friction wedges the body in, the pressure may grow without "
    "a bound, and there may be no equilibrium."
)
_NESTED_WAY_OUT = "Take solver.friction: inside, which needs no contraction."
_INTERIOR_WAY_OUT = (
    "Raise solver.max_iterations if it was low.  If the friction bound does not settle, lower "
    "friction.coefficient or enlarge friction.smoothing.radius."
)


def newton_with_continuation(
    system: PenalisedSystem,
    target: Target,
    settings: Settings,
    monitor: Monitor,
    saved: SavedState | None = None,
) -> SolverReport:
    """SNES with the penalty made stiffer stage by stage and the friction bound updated outside.

    From a saved state it goes on with the penalties of that state; where this fails, from nothing.
    """
    report = SolverReport(suggestion=_NEWTON_WAY_OUT)
    if saved is not None:
        saved.enter(system)
        onwards = PenaltyPath.onwards(
            saved.n, saved.epsilon, (*saved.regularisations, 0.0)[0], target
        )
        cautious = dataclasses.replace(
            settings, max_iterations=min(_RESCUE, settings.max_iterations)
        )
        try:
            _follow(onwards, system, target, cautious, monitor, report)
            report.from_saved = True
            return _success(report)
        except NotConverged:
            _forget(system, report)
    try:
        _follow(PenaltyPath.towards(target), system, target, settings, monitor, report)
    except NotConverged as failure:
        report.reason = str(failure)
        return report
    return _success(report)


def _follow(
    path: PenaltyPath,
    system: PenalisedSystem,
    target: Target,
    settings: Settings,
    monitor: Monitor,
    report: SolverReport,
) -> None:
    """Newton's method along a path of penalties; raises NotConverged, the last stage in place."""
    newton = NewtonSolver(system, settings, monitor)
    bound = None if system.bound is None or system.bound.frictionless else system.bound

    def stage(penalties: Penalties, last: bool) -> None:
        n, epsilon, _ = penalties
        system.set_penalty(n, epsilon, [penalties[2]] * len(system.contacts))
        monitor.stage(len(report.stages) + 1, round(path.decades) + 1, n, epsilon)
        before = report.tangents
        if last:
            _settle(newton, system, target, settings, report, monitor)
        else:
            newton.solve(_INTERMEDIATE_TOLERANCE, report)
            if bound is not None:
                bound.values = bound.evaluate()
                report.friction += 1
        report.stages.append({"n": n, "epsilon": epsilon, "tangents": report.tangents - before})

    try:
        follow(path, stage)
    finally:
        newton.destroy()


def interior_point(
    system: PenalisedSystem,
    target: Target,
    settings: Settings,
    monitor: Monitor,
    saved: SavedState | None = None,
) -> SolverReport:
    """The interior point method, for a finite n polished by Newton where Newton can.

    It starts from nothing.  A saved state so near that Newton arrives from it makes it needless.
    """
    report = SolverReport(suggestion=_INTERIOR_WAY_OUT)
    monitor.stage(1, 1, target.n, target.epsilon)
    if saved is not None and _newton_from(saved, system, target, settings, report, monitor):
        report.stages.append(_stage_of(target, report))
        report.from_saved = True
        return _success(report)
    bound = system.bound
    nested = settings.nested and bound is not None and not bound.frictionless
    if nested:
        report.suggestion = _NESTED_WAY_OUT
    solver = InteriorPoint(system, target, settings, monitor, bound_moves=not nested)
    moves = bound is not None and not bound.frictionless and not nested
    tries = APPROACHES if moves else APPROACHES[:1]
    try:
        for solver.approach in tries:
            _solve_by(solver, bound if nested else None, system, target, settings, report, monitor)
            if not report.reason or report.is_infeasible:
                break
        report.stages.append(_stage_of(target, report))
        if not report.reason:
            # Newton's last steps want a linear solver as sharp as they are.
            if solver.direct is not None and not solver.is_elastic:
                _polish(system, target, settings, report, monitor, _POLISH, solver.direct)
            return _success(report)
    finally:
        solver.destroy()
    if _polish(system, target, settings, report, monitor, _RESCUE, near=False):
        return _success(report)
    _explain(system, target, settings, report)
    return report


def _solve_by(
    solver: InteriorPoint,
    nested: FrictionBound | None,
    system: PenalisedSystem,
    target: Target,
    settings: Settings,
    report: SolverReport,
    monitor: Monitor,
) -> None:
    """Once, or for each value of a ``nested`` bound; why it failed is left in the report."""
    start = system.u.x.array * (1.0 - system.free_dofs())
    report.reason, report.multipliers = "", None

    def solve() -> None:
        system.u.x.array[:] = start
        report.multipliers = solver.solve(report)

    def evaluate() -> npt.NDArray[np.float64]:
        assert nested is not None and report.multipliers is not None
        return nested.evaluate(report.multipliers.contacts[0].pressure)

    try:
        solve()
        if nested is not None:
            nested.values = evaluate()
            least = _least_bound(system, target)
            fixed_point(nested, solve, settings, report, monitor, least, evaluate)
    except NotConverged as failure:
        report.multipliers = report.multipliers or solver.multipliers()
        report.reason, report.is_infeasible = str(failure), isinstance(failure, Infeasible)


def _newton_from(
    saved: SavedState,
    system: PenalisedSystem,
    target: Target,
    settings: Settings,
    report: SolverReport,
    monitor: Monitor,
) -> bool:
    """Newton from a saved state that is near; says whether it arrived, else starts afresh."""
    if is_direct(settings.linear, system.dim, system.size) and _has_digits(target):
        saved.enter(system)
        system.set_penalty(target.n, target.epsilon, target.regularisations)
        if system.relative_residual(settings.tolerance) <= _NEAR:
            updates = min(_FEW_UPDATES, settings.max_friction_updates)
            few = dataclasses.replace(settings, max_friction_updates=updates)
            if _polish(system, target, few, report, monitor, _FEW_STEPS):
                return True
    _forget(system, report)
    return False


def _forget(system: PenalisedSystem, report: SolverReport) -> None:
    """Start from nothing after a try from a saved state; what the try took stays counted."""
    system.clear()
    report.stages.clear()
    report.friction_change = report.contraction = None


def _stage_of(target: Target, report: SolverReport) -> dict[str, float | int]:
    return {"n": target.n, "epsilon": target.epsilon, "tangents": report.tangents}


def _explain(
    system: PenalisedSystem, target: Target, settings: Settings, report: SolverReport
) -> None:
    """Say why the problem was not solved, if nothing is admissible or friction is too large."""
    verdict = judge(system, target, settings, report)
    if verdict is None:
        share = None if settings.nested else share_of_friction(system, target, settings, report)
        if share is not None:
            report.reason += f"; {share}"
            report.suggestion = _FRICTION_WAY_OUT
        return
    report.reason, report.admissible_factor = verdict.reason, verdict.factor
    report.suggestion = _INFEASIBLE_WAY_OUT
    if verdict.factor is not None:
        low, high = (f"{100.0 * share:.3g}" for share in verdict.factor)
        share = f"{low} to {high}" if verdict.factor[0] else f"less than {high}"
        report.reason += f"; {share} % of the prescribed displacements can be followed on this mesh"


def _polish(
    system: PenalisedSystem,
    target: Target,
    settings: Settings,
    report: SolverReport,
    monitor: Monitor,
    steps: int,
    direct: PETSc.KSP | None = None,
    near: bool = True,
) -> bool:
    """Newton from the present state; where it fails, that stays.  Says whether it arrived."""
    if not _has_digits(target):
        return False
    settings = dataclasses.replace(settings, max_iterations=min(steps, settings.max_iterations))
    kept = system.u.x.array.copy()
    change_kept, contraction_kept = report.friction_change, report.contraction
    bound_kept = None if system.bound is None else system.bound.values.copy()
    system.set_penalty(target.n, target.epsilon, target.regularisations)
    newton = NewtonSolver(system, settings, monitor, near, direct)
    try:
        _settle(newton, system, target, settings, report, monitor)
        report.multipliers = None
        return True
    except NotConverged:
        system.u.x.array[:] = kept
        report.friction_change, report.contraction = change_kept, contraction_kept
        if system.bound is not None and bound_kept is not None:
            system.bound.values = bound_kept
        return False
    finally:
        newton.destroy()


def _has_digits(target: Target) -> bool:
    """Whether the penalties leave the residual of (26) digits enough for Newton."""
    shortest = min(target.epsilon * target.young, target.regularisation)
    sharpest = target.length / _POLISHED_UP_TO
    return target.n <= _POLISHED_UP_TO * target.stiffness and shortest >= sharpest


def _settle(
    newton: NewtonSolver,
    system: PenalisedSystem,
    target: Target,
    settings: Settings,
    report: SolverReport,
    monitor: Monitor,
) -> None:
    """Solve to the tolerances, with the friction bound's fixed point where there is friction."""
    if system.bound is None or system.bound.frictionless:
        newton.solve(settings.tolerance, report)
        return

    def solve() -> None:
        newton.solve(_INNER_SHARE * settings.tolerance, report, least_steps=1)

    least = _least_bound(system, target)
    fixed_point(system.bound, solve, settings, report, monitor, least)
    newton.solve(settings.tolerance, report)


def _least_bound(system: PenalisedSystem, target: Target) -> Callable[[], float]:
    return lambda: target.least_bound(system.energy(), system.dim)


def _success(report: SolverReport) -> SolverReport:
    report.converged, report.reason, report.suggestion = True, "every criterion held", ""
    return report


Strategy = Callable[[PenalisedSystem, Target, Settings, Monitor, SavedState | None], SolverReport]

METHODS: Mapping[str, Strategy] = {
    "auto": interior_point,
    "interior_point": interior_point,
    "newton": newton_with_continuation,
}


def solve(
    method: str,
    system: PenalisedSystem,
    target: Target,
    settings: Settings,
    monitor: Monitor,
    saved: SavedState | None = None,
) -> SolverReport:
    """Solve ``system`` for the penalty of ``target`` by the named method; collective.

    ``saved`` is where to go on from if that is any use; ``report.from_saved`` says whether it was.
    Raises InputError for a method there is not.
    """
    if method not in METHODS:
        raise InputError(f"no solver {method!r}; there are: {', '.join(METHODS)}", "solver.method")
    return METHODS[method](system, target, settings, monitor, saved)
