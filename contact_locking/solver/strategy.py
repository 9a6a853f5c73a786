"""The nonlinear strategies by name, and the one entry point to them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from contact_locking.errors import InputError, NotConverged
from contact_locking.progress import Monitor
from contact_locking.solver.continuation import PenaltyPath, follow
from contact_locking.solver.friction import fixed_point
from contact_locking.solver.newton import NewtonSolver
from contact_locking.solver.report import Settings, SolverReport
from contact_locking.system import PenalisedSystem

# Stages before the last only have to be good starting points.
_INTERMEDIATE_TOLERANCE = 1e-2
# The last digits of the friction bound need an equilibrium that is sharper than the bound.
_INNER_SHARE = 0.1


def newton_with_continuation(
    system: PenalisedSystem, path: PenaltyPath, settings: Settings, monitor: Monitor
) -> SolverReport:
    """SNES with the penalty made stiffer stage by stage and the friction bound updated outside."""
    report = SolverReport()
    newton = NewtonSolver(system, settings, monitor)
    bound = system.bound

    def stage(n: float, epsilon: float, last: bool) -> None:
        system.set_penalty(n, epsilon)
        monitor.stage(len(report.stages) + 1, round(path.decades) + 1, n, epsilon)
        before = report.tangents
        if not last:
            newton.solve(_INTERMEDIATE_TOLERANCE, report)
            if bound is not None:
                bound.values = bound.evaluate()
                report.friction += 1
        elif bound is None:
            newton.solve(settings.tolerance, report)
        else:
            inner = _INNER_SHARE * settings.tolerance
            solve = lambda: newton.solve(inner, report)  # noqa: E731
            fixed_point(bound, solve, settings, report, monitor)
        report.stages.append({"n": n, "epsilon": epsilon, "tangents": report.tangents - before})

    try:
        follow(path, stage)
        report.converged, report.reason = True, "every criterion held"
    except NotConverged as failure:
        report.reason = str(failure)
        report.suggestion = (
            "Lower penalty.n or raise penalty.epsilon, load in smaller steps, or refine the mesh; "
            "if the friction bound does not settle, lower friction.coefficient or enlarge "
            "friction.smoothing.radius."
        )
    finally:
        newton.destroy()
    return report


Strategy = Callable[[PenalisedSystem, PenaltyPath, Settings, Monitor], SolverReport]

METHODS: Mapping[str, Strategy] = {
    "auto": newton_with_continuation,
    "newton": newton_with_continuation,
}


def solve(
    method: str,
    system: PenalisedSystem,
    path: PenaltyPath,
    settings: Settings,
    monitor: Monitor,
) -> SolverReport:
    """Solve ``system`` at the end of ``path`` by the named method; collective.

    Raises InputError for a method there is not.
    """
    if method not in METHODS:
        raise InputError(f"no solver {method!r}; there are: {', '.join(METHODS)}", "solver.method")
    return METHODS[method](system, path, settings, monitor)
