"""How much of the prescribed displacements a body can follow, if it cannot follow them all."""

from __future__ import annotations

import math

from contact_locking.errors import Infeasible, NotConverged
from contact_locking.progress import Monitor
from contact_locking.solver.interior_point import InteriorPoint
from contact_locking.solver.report import Settings, SolverReport
from contact_locking.solver.target import Target
from contact_locking.system import PenalisedSystem

# How close the factor that works and the one that does not have to be.
_PRECISION = 0.01
_ROUNDS = 8


def admissible_factor(
    system: PenalisedSystem,
    target: Target,
    settings: Settings,
    report: SolverReport,
    excluded: float,
) -> tuple[float, float]:
    """The largest s such that an admissible field follows s u_D, between two numbers.

    ``excluded`` is the factor that the first failure proved too large.  Every try just below it
    either works or excludes more; friction and elasticity have no say in it.  The first number is 0
    if nothing that was tried worked.  The displacement and the friction bound of ``system`` are
    left as they are; collective.
    """
    displacement = system.u.x.array.copy()
    bound = None if system.bound is None else system.bound.values.copy()
    works = 0.0
    solver = InteriorPoint(system, target, settings, Monitor(), bound_moves=False)
    try:
        if system.bound is not None:
            system.bound.values = 0.0 * system.bound.values
        for _ in range(_ROUNDS):
            trial = (1.0 - 0.5 * _PRECISION) * excluded
            system.u.x.array[:] = trial * displacement * (1.0 - system.free_dofs())
            try:
                solver.solve(report)
            except Infeasible as failure:
                if not math.isfinite(failure.factor):
                    break
                excluded = min(trial, trial * failure.factor)
            else:
                works = trial
                break
    except NotConverged:
        # The bracket so far is what is known.
        pass
    finally:
        solver.destroy()
        system.u.x.array[:] = displacement
        if system.bound is not None and bound is not None:
            system.bound.values = bound
    return works, excluded
