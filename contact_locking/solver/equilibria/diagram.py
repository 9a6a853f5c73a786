"""The bifurcation diagram: the branch of solutions over the share of friction, with its folds."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

from contact_locking.errors import NotConverged
from contact_locking.solver.equilibria.branch import Branch
from contact_locking.solver.equilibria.search import FARTHEST, Equilibria, require_map
from contact_locking.solver.task import Task

# The most points of a diagram.
_MOST_POINTS = 150


@dataclass(frozen=True)
class DiagramPoint:
    """A solution with the ``share`` of friction, and its totals over all contacts with friction.

    ``pressure`` is ``int p`` and ``bound`` is ``int G``.  ``index`` is the sign of
    ``det(I - t Phi'(G))``, 0 at a fold, where the share turns and ``fold`` is 1.
    """

    share: float
    pressure: float
    bound: float
    index: int
    fold: int


@dataclass(frozen=True)
class Diagram:
    """The points from no friction on, in the order of the branch, and why it ends, in words."""

    points: tuple[DiagramPoint, ...]
    end: str

    @property
    def folds(self) -> list[float]:
        """The shares at which the branch turns."""
        return [point.share for point in self.points if point.fold]


def diagram(task: Task, most: float) -> Diagram:
    """The branch up to ``most`` times the friction; the system is left as it was; collective.

    Raises InputError where there is no map of the friction bounds.
    """
    require_map(task, "branches")
    points, equilibria = [], Equilibria(task)
    problem, vectors = equilibria.map, equilibria.map.vectors
    end = "no further step along the branch was found"
    try:
        with task.system.preserved():
            branch = Branch(problem, locates_folds=True)
            for point in itertools.islice(branch.points(), _MOST_POINTS):
                try:
                    problem(point.bounds)
                except NotConverged:
                    break
                pressure = vectors.dot(problem.pressures(), vectors.ones)
                bound = vectors.dot(point.bounds, vectors.ones)
                is_fold = point.sign == 0.0
                points.append(
                    DiagramPoint(point.share, pressure, bound, int(point.sign), int(is_fold))
                )
                if branch.reach > FARTHEST and task.target.penalty.is_strict:
                    end = (
                        f"the friction bound is {branch.reach:.0f} times that of the pressure "
                        "without friction, and grows"
                    )
                    break
                if point.share >= most:
                    end = "the largest share was reached"
                    break
            else:
                if len(points) == _MOST_POINTS:
                    end = f"after {_MOST_POINTS} points"
            if not points:
                end = "no node presses without friction, so that no share of it does anything"
    finally:
        equilibria.destroy()
    return Diagram(tuple(points), end)
