"""The bifurcation diagram: a branch of solutions over a share of friction or loads, with folds."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

from contact_locking.arrays import FloatArray
from contact_locking.errors import NotConverged
from contact_locking.solver.task import Task
from contact_locking.theory.equilibria.branch import Branch, OverFriction, OverLoads, Path
from contact_locking.theory.equilibria.search import FARTHEST, Equilibria, require_map

# The most points of a diagram.
_MOST_POINTS = 150
_STOPPED = "no further step along the branch was found"


@dataclass(frozen=True)
class DiagramPoint:
    """A solution with its ``share``, and its totals over all contacts with friction.

    ``pressure`` is ``int p`` and ``bound`` is ``int G``.  ``index`` is the sign of
    ``det(I - dPsi/dG)``, 0 at a fold, where the share turns and ``fold`` is 1.
    """

    share: float
    pressure: float
    bound: float
    index: int
    fold: int


@dataclass(frozen=True)
class Diagram:
    """The points in the order of the branch, and why it ends, in words."""

    points: tuple[DiagramPoint, ...]
    end: str

    @property
    def folds(self) -> list[float]:
        """The shares at which the branch turns."""
        return [point.share for point in self.points if point.fold]


#: The diagram over loads without a solution for the whole of them.
NO_START = Diagram((), "it begins at the solution for all of the loads, which was not found")


def diagram(task: Task, to: float, put: Callable[[float], None] | None = None) -> Diagram:
    """The branch from no friction up to ``to`` times the friction; collective.

    With ``put``, which gives a share of the loads to the system, it is the branch over the loads,
    from the solution in the system with the share 1 up or down to the share ``to``.  The system is
    left as it was.  Raises InputError where there is no map of the friction bounds.
    """
    require_map(task, "branches")
    equilibria = Equilibria(task)
    problem, vectors = equilibria.map, equilibria.map.vectors
    path: Path = OverFriction(problem)
    start: FloatArray | None = None
    if put is not None:
        path = OverLoads(problem, put)
        start = vectors.in_force()
    try:
        with task.system.preserved():
            return _followed(path, start, to, is_strict=task.target.penalty.is_strict)
    finally:
        if put is not None:
            put(1.0)
        equilibria.destroy()


def _followed(path: Path, start: FloatArray | None, to: float, is_strict: bool) -> Diagram:
    points, vectors = [], path.vectors
    end = _STOPPED
    onwards = -1.0 if start is not None and to < 1.0 else 1.0
    branch = Branch(path, locates_folds=True)
    for point in itertools.islice(branch.points(start, onwards), _MOST_POINTS):
        try:
            path(point.bounds, point.share)
        except NotConverged:
            break
        pressure = vectors.dot(path.problem.pressures(), vectors.ones)
        bound = vectors.dot(point.bounds, vectors.ones)
        is_fold = point.sign == 0.0
        points.append(DiagramPoint(point.share, pressure, bound, int(point.sign), int(is_fold)))
        if is_strict and branch.reach > FARTHEST * max(1.0, point.share):
            beginning = "the pressure without friction" if start is None else "all of the loads"
            end = f"the friction bound is {branch.reach:.0f} times that of {beginning}, and grows"
            break
        if onwards * (point.share - to) >= 0.0:
            end = "the last share was reached"
            break
    else:
        if len(points) == _MOST_POINTS:
            end = f"after {_MOST_POINTS} points"
    if points and end == _STOPPED:
        end = f"it stopped at the share {points[-1].share:.4g}, as {_STOPPED}"
    if not points and start is None:
        end = "no node presses without friction, so that no share of it does anything"
    return Diagram(tuple(points), end)
