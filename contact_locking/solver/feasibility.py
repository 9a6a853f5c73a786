"""Whether anything can follow the prescribed displacements, and with how much friction it does."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from contact_locking.errors import Infeasible, NotConverged
from contact_locking.progress import Monitor
from contact_locking.solver.interior_point import InteriorPoint
from contact_locking.solver.report import Settings, SolverReport
from contact_locking.solver.target import Target
from contact_locking.system import PenalisedSystem

# How close the factor that works and the one that does not have to be.
_PRECISION = 0.01
# The penalty that stands for an infinite one, over the stiffness.
_STIFF = 1e6
_ROUNDS = 8
# The share of the friction coefficient that stands for none, and how often the share is halved in
# on.
_LITTLE = 1e-3
_HALVINGS = 4


@dataclasses.dataclass(frozen=True)
class Verdict:
    """No field in ``K cap K'`` on this mesh has the prescribed values u_D; ``reason`` says where.

    ``factor`` brackets the largest s such that s u_D can be followed: the first number works (0 if
    none was found), the second does not; None where scaling u_D is not the way out.
    """

    reason: str
    factor: tuple[float, float] | None


def judge(
    system: PenalisedSystem, target: Target, settings: Settings, report: SolverReport
) -> Verdict | None:
    """The verdict on a problem that was not solved, None without a proof; collective.

    Friction and penalties have no say in it, so the problem is solved without them, unless friction
    alone holds the body.  Displacement and friction bound of ``system`` are left as they are; what
    it took is added to ``report``.
    """
    displacement = system.u.x.array.copy()
    prescribed = displacement * (1.0 - system.free_dofs())
    if system.held_by_friction or _rest_is_admissible(system, prescribed):
        return None
    bound = system.bound
    bound_kept = None if bound is None else bound.values
    limit = target.inequality()
    # Its multipliers grow with the penalty where nothing is admissible, and then balance.
    stiff = dataclasses.replace(
        limit,
        n=_STIFF * target.stiffness,
        epsilon=target.length / (_STIFF * target.stiffness),
    )
    solver, penalised = (
        InteriorPoint(system, wanted, settings, Monitor(), bound_moves=False)
        for wanted in (limit, stiff)
    )
    tries = SolverReport()

    def fails(factor: float) -> Infeasible | None:
        system.u.x.array[:] = factor * prescribed
        try:
            solver.solve(tries)
            return None
        except Infeasible as failure:
            return failure
        except NotConverged as failure:
            unsolved = failure
        system.u.x.array[:] = factor * prescribed
        try:
            penalised.solve(tries)
            penalised.require_feasible()
        except Infeasible as failure:
            return failure
        raise unsolved

    try:
        if bound is not None:
            bound.values = np.zeros_like(bound.values)
        failure = fails(1.0)
        if failure is None:
            return None
        scales = 0.0 < failure.factor < math.inf
        works = _largest(fails, failure.factor) if scales else None
        return Verdict(str(failure), works)
    except NotConverged:
        return None
    finally:
        solver.destroy()
        penalised.destroy()
        report.tangents += tries.tangents
        report.linear += tries.linear
        system.u.x.array[:] = displacement
        if bound is not None and bound_kept is not None:
            bound.values = bound_kept


def share_of_friction(
    system: PenalisedSystem, target: Target, settings: Settings, report: SolverReport
) -> str | None:
    """Up to which share of the friction coefficient a solution was found, in words; collective.

    None where friction is nothing, or where the problem is not solved without it either.  This is
    a search, and proves nothing.  Displacement and friction bound of ``system`` are left as they
    are; what it took is added to ``report``.
    """
    bound = system.bound
    if bound is None or bound.frictionless or system.held_by_friction:
        return None
    displacement, bound_kept = system.u.x.array.copy(), bound.values
    prescribed = displacement * (1.0 - system.free_dofs())
    solver = InteriorPoint(system, target, settings, Monitor())
    tries = SolverReport()

    def pressure(share: float) -> float | None:
        """The mean pressure with this share of the friction coefficient, None without solution."""
        system.u.x.array[:] = prescribed
        bound.share = share
        try:
            found = solver.solve(tries).contacts[0].pressure
        except NotConverged:
            return None
        return float(bound.surface.integral(found))

    try:
        low, high, last = 0.0, 1.0, pressure(_LITTLE)
        if last is None:
            return None
        first = last
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            found = pressure(middle)
            if found is None:
                high = middle
            else:
                low, last = middle, found
        growth = f" (and {last / first:.3g} times the contact force of none)" if first else ""
        return (
            f"a solution was found with {100.0 * low:.0f} % of friction.coefficient{growth}, but "
            f"not with {100.0 * high:.0f} %"
        )
    finally:
        bound.share = 1.0
        solver.destroy()
        report.tangents += tries.tangents
        report.linear += tries.linear
        system.u.x.array[:] = displacement
        bound.values = bound_kept


def _largest(fails: Callable[[float], Infeasible | None], excluded: float) -> tuple[float, float]:
    """Every try just below what is excluded either works or excludes more."""
    for _ in range(_ROUNDS):
        trial = (1.0 - 0.5 * _PRECISION) * excluded
        try:
            failure = fails(trial)
        except NotConverged:
            break
        if failure is None:
            return trial, excluded
        excluded = trial * min(1.0, failure.factor)
    return 0.0, excluded


def _rest_is_admissible(system: PenalisedSystem, prescribed: npt.NDArray[np.float64]) -> bool:
    """Whether u = 0 is within the limit and the gap and has the prescribed values; collective."""
    contact = system.data.contact
    moves = bool(np.any(prescribed != 0.0))
    overlaps = contact is not None and bool(np.any(contact.gap.x.array < 0.0))
    return not system.comm.allreduce(moves or overlaps)
