"""A branch of solutions ``G = Psi(G, s)`` over a share s of the friction coefficient or of loads.

Over friction, ``Psi = t Phi(G)``, it begins at ``G = 0`` for ``t = 0``.  Where Phi is continuous,
the solutions (G, t) that are connected to this one reach as far as there are any (Rabinowitz,
doi:10.1016/0022-1236(71)90030-9): where Phi is bounded, they reach ``t = 1``, but t need not grow
along the branch.  So the branch is followed by pseudo-arclength, past folds.  One value of Phi
serves all shares.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import NotConverged
from contact_locking.theory.equilibria.bound_map import BoundMap

# The relative residual along the branch, and the corrections that a step may take.
_ACCURACY, _MOST, _FEW = 1e-4, 8, 4
# The first step, in shares of friction, the longest and the shortest.
_FIRST, _LONGEST, _SHORTEST = 0.1, 0.25, 1e-5
# Where the bounds are large, a step changes them by this share of themselves, and a bold one by the
# next where they are so many times those without friction: there they mostly grow along a line.
_GROWTH, _BOLD_GROWTH, _FAR = 0.125, 0.5, 10.0
_LONGER, _SHORTER = 1.5, 0.5
# So often is the step to a fold halved.
_BISECTIONS = 8
# The step beyond a kink at which no other step leads on.
_KINK = 1e-3
# Corrections may lead aside by this share of a step that is not bold.
_ASIDE = 0.6
# The change of the share in a difference.
_WIDTH = 1e-4


class OverShare:
    """``Psi(G, s)``: ``s Phi(G)``, or ``Phi(G)`` with loads for the share s.

    ``put`` gives a share of the loads to the system; without it the share is that of the friction
    coefficient.
    """

    def __init__(self, problem: BoundMap, put: Callable[[float], None] | None = None) -> None:
        self.problem, self.vectors, self._put = problem, problem.vectors, put
        self._bounds = self._wanted = np.zeros(problem.vectors.size)
        self._share = 0.0

    def __call__(self, bounds: FloatArray, share: float) -> FloatArray:
        """``Psi(G, s)`` (m,); raises NotConverged where Tresca's problem is not solved."""
        self._bounds, self._share = bounds, share
        self._wanted = self._at(share)
        return share * self._wanted if self._put is None else self._wanted

    def slopes(self) -> tuple[FloatArray, FloatArray]:
        """The derivatives of Psi by G (m, m) and by s (m,) at the last value; collective."""
        by_bounds = self.problem.derivative()
        if self._put is None:
            return self._share * by_bounds, self._wanted
        beside = self._at(self._share + _WIDTH)
        return by_bounds, np.asarray((beside - self._wanted) / _WIDTH)

    def _at(self, share: float) -> FloatArray:
        if self._put is not None:
            self._put(share)
        return self.problem(self._bounds)


@dataclass(frozen=True)
class BranchPoint:
    """Bounds ``G = Psi(G, s)``, their share s, the sign of ``det(I - dPsi/dG)``, 0 at a fold."""

    bounds: FloatArray
    share: float
    sign: float

    def between(self, other: BranchPoint, share: float) -> FloatArray:
        """The bounds for a share on the line from this point to another one."""
        part = (share - self.share) / (other.share - self.share)
        return np.asarray(self.bounds + part * (other.bounds - self.bounds))


class Branch:
    """The points of a branch, step by step; each takes some values of the map Psi.

    ``reach`` is the size of the bounds, relative to those of the pressure without friction.  A
    ``bold`` step may lead to another branch, which is faster where any solution will do.  With
    ``locates_folds`` the places where the share turns are points, too.
    """

    def __init__(self, path: OverShare, bold: bool = False, locates_folds: bool = False) -> None:
        self._locates_folds = locates_folds
        self._path, self._vectors = path, path.vectors
        self._bold, self._aside = bold, math.inf if bold else _ASIDE
        self._size, self._side, self.reach = 1.0, 1.0, 0.0

    def points(
        self, start: FloatArray | None = None, direction: float = 1.0
    ) -> Iterator[BranchPoint]:
        """The points from no friction, or from a solution, as long as a step leads on; collective.

        From a solution of the share 1 the branch leads on to both sides: ``direction`` is +1
        towards a larger share and -1 towards a smaller one, at first.
        """
        size = self._vectors.size
        bounds: FloatArray = np.zeros(size) if start is None else start
        share = 0.0 if start is None else 1.0
        try:
            self._path(bounds, share)
            by_bounds, by_share = self._path.slopes()
        except NotConverged:
            return
        self._size = self._vectors.norm(by_share if start is None else start)
        rate, sign = self._vectors.solved(np.eye(size) - by_bounds, by_share)
        if self._size == 0.0 or sign == 0.0:
            return
        self._side = sign * direction
        tangent = self._unit(direction * np.append(rate, 1.0))
        at, length = np.append(bounds, share), _FIRST
        yield BranchPoint(bounds, share, sign)
        while True:
            found, is_at_kink = self._correct(at, length, tangent), False
            while found is None:
                length *= _SHORTER
                if length < _SHORTEST:
                    beyond = None if is_at_kink else self._beyond(at, tangent)
                    if beyond is None:
                        return
                    if self._locates_folds and beyond[-1] * tangent[-1] < 0.0:
                        yield BranchPoint(at[:-1], float(at[-1]), 0.0)
                    tangent, length, is_at_kink = beyond, _FIRST, True
                found = self._correct(at, length, tangent)
            if self._locates_folds and found[1][-1] * tangent[-1] < 0.0:
                yield self._fold(at, length, tangent)
            at, tangent, sign, count = found
            self.reach = self._vectors.norm(at[:size]) / self._size
            if at[-1] < 0.0:
                return
            if count <= _FEW:
                growth = _BOLD_GROWTH if self._bold and self.reach > _FAR else _GROWTH
                length = min(_LONGER * length, max(_LONGEST, growth * self.reach))
            yield BranchPoint(at[:-1], float(at[-1]), sign)

    def _fold(self, before: FloatArray, length: float, tangent: FloatArray) -> BranchPoint:
        """The last point before the share turns, within a step that leads beyond it."""
        low, high, place = 0.0, length, before
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            found = self._correct(before, middle, tangent)
            if found is None:
                break
            if found[1][-1] * tangent[-1] > 0.0:
                low, place = middle, found[0]
            else:
                high = middle
        return BranchPoint(place[:-1], float(place[-1]), 0.0)

    def _beyond(self, at: FloatArray, tangent: FloatArray) -> FloatArray | None:
        """The tangent just beyond a point at a kink, where some node begins to slip or to stick."""
        aside = at + _KINK * tangent
        try:
            self._path(aside[:-1], float(aside[-1]))
            by_bounds, by_share = self._path.slopes()
        except NotConverged:
            return None
        return self._tangent(by_bounds, by_share, tangent)[0]

    def _tangent(
        self, by_bounds: FloatArray, by_share: FloatArray, before: FloatArray
    ) -> tuple[FloatArray | None, FloatArray]:
        """The tangent by the slopes of Psi, on the side of one before, and the matrix of steps.

        None where that is singular.
        """
        size = self._vectors.size
        slope, row = np.eye(size) - by_bounds, self._covector(before)
        matrix = np.block([[slope, -by_share[:, None]], [row[None, :]]])
        # The determinant with the tangent as the last row keeps its sign along a branch, also where
        # a kink turns the tangent round.
        ahead, turn = self._vectors.solved(matrix, np.append(np.zeros(size), 1.0))
        return (None if turn == 0.0 else self._unit(turn * self._side * ahead)), matrix

    def _correct(
        self, before: FloatArray, length: float, tangent: FloatArray
    ) -> tuple[FloatArray, FloatArray, float, int] | None:
        """The point on the plane across the tangent, the tangent, its sign, and the corrections.

        None also where they lead so far that the point may belong to another branch.
        """
        start = before + length * tangent
        at, vectors = start, self._vectors
        row = self._covector(tangent)
        for count in range(_MOST):
            try:
                wanted = self._path(at[:-1], float(at[-1]))
                by_bounds, by_share = self._path.slopes()
            except NotConverged:
                return None
            left = np.append(at[:-1] - wanted, row @ (at - start))
            ahead, matrix = self._tangent(by_bounds, by_share, tangent)
            if vectors.norm(left[:-1]) <= _ACCURACY * self._size:
                if ahead is None or self._length(at - start) > self._aside * length:
                    return None
                sign = vectors.solved(matrix[:-1, :-1], by_share)[1]
                return at, ahead, sign, count
            step = vectors.solved(matrix, left)[0]
            if not np.all(np.isfinite(step)):
                return None
            at = at - step
        return None

    def _covector(self, tangent: FloatArray) -> FloatArray:
        return np.append(self._vectors.weights * tangent[:-1] / self._size**2, tangent[-1])

    def _length(self, step: FloatArray) -> float:
        square = self._vectors.dot(step[:-1], step[:-1]) / self._size**2 + step[-1] ** 2
        return math.sqrt(square)

    def _unit(self, tangent: FloatArray) -> FloatArray:
        return np.asarray(tangent / self._length(tangent))
