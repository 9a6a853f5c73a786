"""Whether anything can follow the prescribed displacements."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from contact_locking.errors import Infeasible, NotConverged
from contact_locking.laws.penalty import Penalty
from contact_locking.solver.interior_point.method import InteriorPoint
from contact_locking.solver.task import Counts, Target, Task

# How close the factor that works and the one that does not have to be.
_PRECISION = 0.01
# The penalty that stands for an infinite one, over the stiffness.
_STIFF = 1e6
_ROUNDS = 8

_INFEASIBLE_WAY_OUT = (
    "Refine the mesh, lower the prescribed displacements, raise material.locking_limit (or the "
    "limits of material.locking), or move the foundation away; a soft penalty.n has a solution "
    "that exceeds the limit."
)


@dataclasses.dataclass(frozen=True)
class Verdict:
    """No field in ``K cap K'`` on this mesh has the prescribed values u_D; ``place`` says where.

    ``factor`` brackets the largest s such that s u_D can be followed: the first number works (0 if
    none was found), the second does not; None where scaling u_D is not the way out.
    """

    place: str
    factor: tuple[float, float] | None
    way_out: ClassVar[str] = _INFEASIBLE_WAY_OUT

    @property
    def reason(self) -> str:
        """Why there is no solution, and how much can be followed, in words."""
        if self.factor is None:
            return self.place
        low, high = (f"{100.0 * share:.3g}" for share in self.factor)
        share = f"{low} to {high}" if self.factor[0] else f"less than {high}"
        return (
            f"{self.place}; {share} % of the prescribed displacements can be followed on this mesh"
        )


def judge(task: Task) -> Verdict | None:
    """The verdict on a problem that was not solved, None without a proof; collective.

    Friction and penalties have no say in it, so the problem is solved without them, unless
    friction alone holds the body.  The system is left as it is; what it took is counted.
    """
    system = task.system
    prescribed = system.constraints.held_part(system.u.x.array)
    # Whether u = 0 is within the limit and the gaps and has the prescribed values.
    overlaps = any(bool(np.any(contact.gaps < 0.0)) for contact in system.contacts)
    rests = not system.comm.allreduce(bool(prescribed.any()) or overlaps)
    if system.held_by_friction or rests:
        return None
    with task.system.preserved():
        tries = Counts()
        limit = dataclasses.replace(task.target, penalty=task.target.penalty.inequality())
        exact, penalised = (
            InteriorPoint(task.aside(tries, target), bound_moves=False)
            for target in (limit, _stiff(limit))
        )

        def fails(factor: float) -> Infeasible | None:
            system.u.x.array[:] = factor * prescribed
            try:
                exact.solve()
                return None
            except Infeasible as failure:
                return failure
            except NotConverged as failure:
                unsolved = failure
            system.u.x.array[:] = factor * prescribed
            try:
                penalised.solve()
                penalised.require_feasible()
            except Infeasible as failure:
                return failure
            raise unsolved

        try:
            system.remove_friction()
            failure = fails(1.0)
            if failure is None:
                return None
            scales = 0.0 < failure.factor < math.inf
            works = _largest(fails, failure.factor) if scales else None
            return Verdict(str(failure), works)
        except NotConverged:
            return None
        finally:
            task.counts.add(tries)
            exact.destroy()
            penalised.destroy()


def _stiff(target: Target) -> Target:
    """A penalised problem, the multipliers of which balance where nothing is admissible."""
    n = _STIFF * target.stiffness
    penalty = Penalty(n, target.length / n, target.penalty.regularisations)
    return dataclasses.replace(target, penalty=penalty)


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
