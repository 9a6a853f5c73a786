"""The map of friction bounds whose fixed points are the equilibria, and Newton's method on it.

``Phi(G) = mu(|u_tau(G)|) |R p(G)|``, where ``u(G)`` and ``p(G)`` solve Tresca's problem, friction
under the known bound G, which is convex.  Its unknowns are those of the nodes of Gamma_C with
friction, few beside those of the body.

The residual ``rho(G) = G - Phi(G)`` is semismooth.  Deflation (arXiv 1904.13299) multiplies it by
``M(G) = prod (1 + size^2/|G - G_i|^2)``, which keeps Newton's method away from the known solutions
G_i and has no other zeros.  The step of ``M rho`` is a multiple of that of ``rho``.

A branch of solutions ``G = Psi(G, s)`` over a share s of the friction coefficient or of loads.

Over friction, ``Psi = t Phi(G)``, it begins at ``G = 0`` for ``t = 0``.  Where Phi is continuous,
the solutions (G, t) that are connected to this one reach as far as there are any (Rabinowitz,
doi:10.1016/0022-1236(71)90030-9): where Phi is bounded, they reach ``t = 1``, but t need not grow
along the branch.  So the branch is followed by pseudo-arclength, past folds.  One value of Phi
serves all shares.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import NotConverged
from contact_locking.problem.system import System
from contact_locking.solver.interior_point.method import InteriorPoint
from contact_locking.solver.task import Outcome, SavedState, Task

# No bound is a smaller share of the largest, so that the friction cones have an inside.
_LEAST = 1e-12


class BoundVectors:
    """Friction bounds of all contacts as vectors (m,), the same on all ranks.

    They hold the nodes at which friction acts, rank by rank and contact by contact.  ``weights``
    (m,) are those of the nodes.  The constructor is collective.
    """

    def __init__(self, system: System) -> None:
        self._comm, self._bounds = system.comm, system.bounds
        self.contacts = system.rubbing
        self._counts = [int(np.count_nonzero(contact.free)) for contact in self.contacts]
        sizes = self._comm.allgather(sum(self._counts))
        first = sum(sizes[: self._comm.rank])
        self._own = slice(first, first + sizes[self._comm.rank])
        self.size = sum(sizes)
        self.weights = self.gather([contact.surface.weights for contact in self.contacts])
        self.ones: FloatArray = np.ones(self.size)

    def gather(self, values: list[FloatArray]) -> FloatArray:
        """The vector of values at the owned nodes of each contact; collective."""
        pairs = zip(values, self.contacts, strict=True)
        return self.join([values[contact.free] for values, contact in pairs])

    def join(self, values: list[FloatArray]) -> FloatArray:
        """The vector of values at the nodes of each contact where friction acts; collective."""
        local: FloatArray = np.concatenate([*values, np.empty(0)])
        return np.concatenate(self._comm.allgather(local))

    def split(self, vector: FloatArray) -> list[FloatArray]:
        """The values of this rank at the nodes of each contact where friction acts."""
        return np.split(vector[self._own], np.cumsum(self._counts)[:-1])

    def set_in_force(self, vector: FloatArray) -> None:
        """Let the bounds of a vector be in force; collective."""
        for contact, values in zip(self.contacts, self.split(vector), strict=True):
            bounds = np.zeros(len(contact.free))
            bounds[contact.free] = values
            self._bounds[contact] = bounds

    def in_force(self) -> FloatArray:
        """The vector of the bounds in force; collective."""
        return self.gather(self._bounds.at(self.contacts))

    def dot(self, a: FloatArray, b: FloatArray) -> float:
        """``int a b`` over Gamma_C by the weights of the nodes, alike on all ranks; collective."""
        return float(self._comm.bcast(float(self.weights @ (a * b))))

    def norm(self, a: FloatArray) -> float:
        """The L2 norm on Gamma_C; collective."""
        return math.sqrt(self.dot(a, a))

    def solved(self, matrix: FloatArray, right: FloatArray) -> tuple[FloatArray, float]:
        """The solution of a dense system and its determinant's sign, or NaN and 0; collective."""
        solution: FloatArray = np.full_like(right, np.nan)
        sign = 0.0
        if self._comm.rank == 0 and np.all(np.isfinite(matrix)):
            sign = float(np.linalg.slogdet(matrix)[0])
            if sign != 0.0:
                solution = np.asarray(np.linalg.solve(matrix, right))
        result: tuple[FloatArray, float] = self._comm.bcast((solution, sign))
        return result


class BoundMap:
    """``G -> Phi(G)``: a Tresca problem for each value, and back-substitutions for the derivative.

    A bound that is negative counts as zero.  ``outcome`` is the solution of the last value, and
    ``last`` an iterate near the first, if one is known.  The constructor and all methods are
    collective.
    """

    def __init__(self, task: Task, last: SavedState | None = None) -> None:
        self._task, self.vectors = task, BoundVectors(task.system)
        self._solver = InteriorPoint(task, bound_moves=False)
        self.outcome = Outcome(last=last)
        self._inside = np.ones(self.vectors.size, dtype=bool)

    def __call__(self, bounds: FloatArray) -> FloatArray:
        """``Phi(G)`` (m,); raises NotConverged where Tresca's problem is not solved."""
        system = self._task.system
        self._inside = bounds > 0.0
        used = np.maximum(bounds, 0.0)
        self.vectors.set_in_force(np.maximum(used, _LEAST * np.max(used, initial=0.0)))
        system.u.x.array[:] = 0.0
        system.constraints.apply(system.u)
        # Along a branch the solution before is near.
        self.outcome = self._solver.solve(self.outcome.last)
        pairs = zip(self.vectors.contacts, self._pressures(), strict=True)
        return self.vectors.gather([contact.friction_bound(system.u, p) for contact, p in pairs])

    def pressures(self) -> FloatArray:
        """The contact pressures (m,) at the last value."""
        return self.vectors.gather(self._pressures())

    def _pressures(self) -> list[FloatArray]:
        assert self.outcome.multipliers is not None
        pairs = zip(self._task.system.contacts, self.outcome.multipliers.contacts, strict=True)
        return [forces.pressure for contact, forces in pairs if contact in self.vectors.contacts]

    def derivative(self) -> FloatArray:
        """``Phi'(G)`` (m, m) at the last value, by a back-substitution for each node."""
        size = self.vectors.size
        matrix = np.zeros((size, size))
        laws = self._solver.linearised_bounds()
        if not laws:
            return matrix
        for column in np.flatnonzero(self._inside):
            step = np.zeros(size)
            step[column] = 1.0
            pairs = zip(laws, self.vectors.split(step), strict=True)
            displacement = self._solver.respond(
                {law.friction: law.friction.response(step) for law, step in pairs}
            )
            matrix[:, column] = self.vectors.join([law.moved_by(displacement) for law in laws])
        return matrix

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._solver.destroy()


# Steps are halved so often, and a step is good enough that lowers the residual by this share of it.
_HALVINGS, _DECREASE = 4, 1e-4
# Newton's method gives up after so many steps that did not lower the residual.
_VAIN = 2
# A relative residual below this that no step lowers is that of rounding in Tresca's problems, which
# the map multiplies where a small change of the bounds moves the body far.
_ROUNDING = 1e-3
# Bounds as near as this to each other, relative to their size, belong to one solution.
_SAME = 1e-4


@dataclass(frozen=True)
class Deflation:
    """``M(G)`` for known solutions; ``size`` is that of bounds."""

    vectors: BoundVectors
    known: Sequence[FloatArray] = ()
    size: float = 1.0

    def factor(self, bounds: FloatArray) -> float:
        """``M(G)``, infinite at a known solution."""
        return math.prod(1.0 + self._nearness(bounds, other) for other in self.known)

    def stretch(self, bounds: FloatArray, step: FloatArray) -> float:
        """What Newton's step for ``rho`` is multiplied by to be that for ``M rho``."""
        slope = 0.0
        for other in self.known:
            apart = bounds - other
            near = self._nearness(bounds, other)
            along = self.vectors.dot(apart, step) / self.vectors.dot(apart, apart)
            slope -= 2.0 * near / (1.0 + near) * along
        return 1.0 / (1.0 - slope) if slope != 1.0 else 1.0

    def is_known(self, bounds: FloatArray) -> bool:
        """Whether the bounds are those of a known solution."""
        return any(self.vectors.norm(bounds - other) <= _SAME * self.size for other in self.known)

    def _nearness(self, bounds: FloatArray, other: FloatArray) -> float:
        square = self.vectors.dot(bounds - other, bounds - other)
        return self.size**2 / square if square > 0.0 else math.inf


@dataclass
class MapNewton:
    """Solves ``G = Phi(G)`` in ``limit`` steps at most.

    The solution is as sharp as the relative ``tolerance``, or as rounding in the map lets it be.
    """

    problem: BoundMap
    tolerance: float
    limit: int = 30
    #: The relative residual of the last iterate.
    residual: float = field(default=math.inf, init=False)

    def solve(self, start: FloatArray, deflation: Deflation | None = None) -> FloatArray | None:
        """A solution from a start, or None if none was found; collective."""
        problem, vectors = self.problem, self.problem.vectors
        known = deflation or Deflation(vectors)
        bounds = start
        pair, lowest, vain = self._residual(bounds), math.inf, 0
        for _ in range(self.limit):
            if pair is None or not math.isfinite(known.factor(bounds)):
                return None
            merit = known.factor(bounds) * vectors.norm(pair[1])
            lowest, vain = min(merit, lowest), 0 if merit < lowest else vain + 1
            image, residual = pair
            size = max(vectors.norm(image), np.finfo(float).tiny)
            self.residual = vectors.norm(residual) / size
            if self.residual <= (_ROUNDING if vain else self.tolerance):
                return None if known.is_known(bounds) else bounds
            if vain > _VAIN and not known.known:
                return None
            slope = np.eye(len(bounds)) - problem.derivative()
            step, _ = vectors.solved(slope, -residual)
            if not np.all(np.isfinite(step)):
                return None
            step *= known.stretch(bounds, step)
            if known.known:
                # A line search would stay where it begins; a step is no longer than the bounds.
                step *= min(1.0, known.size / (vectors.norm(step) or 1.0))
                bounds = np.maximum(bounds + step, 0.0)
                pair = self._residual(bounds)
            else:
                bounds, pair = self._search(bounds, step, residual)
        return None

    def _residual(self, bounds: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """``Phi(G)`` and ``G - Phi(G)``, None where Tresca's problem is not solved."""
        try:
            image = self.problem(bounds)
        except NotConverged:
            return None
        return image, bounds - image

    def _search(
        self, bounds: FloatArray, step: FloatArray, residual: FloatArray
    ) -> tuple[FloatArray, tuple[FloatArray, FloatArray] | None]:
        """The first of shorter and shorter steps that lowers the residual, or the best of them."""
        norm, best, t, at = self.problem.vectors.norm, math.inf, 1.0, 1.0
        before = norm(residual)
        for _ in range(_HALVINGS):
            trial = np.maximum(bounds + t * step, 0.0)
            pair = self._residual(trial)
            if pair is not None:
                merit = norm(pair[1])
                if merit <= (1.0 - _DECREASE * t) * before:
                    return trial, pair
                if merit < best:
                    best, at = merit, t
            t *= 0.5
        trial = np.maximum(bounds + at * step, 0.0)
        return trial, self._residual(trial)


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
        self.problem, self.vectors, self._set_share = problem, problem.vectors, put
        self._bounds = self._image = np.zeros(problem.vectors.size)
        self._share = 0.0

    def __call__(self, bounds: FloatArray, share: float) -> FloatArray:
        """``Psi(G, s)`` (m,); raises NotConverged where Tresca's problem is not solved."""
        self._bounds, self._share = bounds, share
        self._image = self._at(share)
        return share * self._image if self._set_share is None else self._image

    def slopes(self) -> tuple[FloatArray, FloatArray]:
        """The derivatives of Psi by G (m, m) and by s (m,) at the last value; collective."""
        by_bounds = self.problem.derivative()
        if self._set_share is None:
            return self._share * by_bounds, self._image
        beside = self._at(self._share + _WIDTH)
        return by_bounds, np.asarray((beside - self._image) / _WIDTH)

    def _at(self, share: float) -> FloatArray:
        if self._set_share is not None:
            self._set_share(share)
        return self.problem(self._bounds)


@dataclass(frozen=True)
class BranchPoint:
    """Bounds ``G = Psi(G, s)``, their share s, the sign of ``det(I - dPsi/dG)``, 0 at a fold."""

    bounds: FloatArray
    share: float
    sign: float

    def between(self, other: BranchPoint, share: float) -> FloatArray:
        """The bounds for a share on the line from this point to another one."""
        weight = (share - self.share) / (other.share - self.share)
        return np.asarray(self.bounds + weight * (other.bounds - self.bounds))


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
            corrected, is_at_kink = self._correct(at, length, tangent), False
            while corrected is None:
                length *= _SHORTER
                if length < _SHORTEST:
                    beyond = None if is_at_kink else self._beyond(at, tangent)
                    if beyond is None:
                        return
                    if self._locates_folds and beyond[-1] * tangent[-1] < 0.0:
                        yield BranchPoint(at[:-1], float(at[-1]), 0.0)
                    tangent, length, is_at_kink = beyond, _FIRST, True
                corrected = self._correct(at, length, tangent)
            if self._locates_folds and corrected[1][-1] * tangent[-1] < 0.0:
                yield self._fold(at, length, tangent)
            at, tangent, sign, count = corrected
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
            corrected = self._correct(before, middle, tangent)
            if corrected is None:
                break
            if corrected[1][-1] * tangent[-1] > 0.0:
                low, place = middle, corrected[0]
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
                image = self._path(at[:-1], float(at[-1]))
                by_bounds, by_share = self._path.slopes()
            except NotConverged:
                return None
            residual = np.append(at[:-1] - image, row @ (at - start))
            ahead, matrix = self._tangent(by_bounds, by_share, tangent)
            if vectors.norm(residual[:-1]) <= _ACCURACY * self._size:
                if ahead is None or self._length(at - start) > self._aside * length:
                    return None
                sign = vectors.solved(matrix[:-1, :-1], by_share)[1]
                return at, ahead, sign, count
            step = vectors.solved(matrix, residual)[0]
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
