"""The map of friction bounds whose fixed points are the equilibria, and Newton's method on it.

``Phi(G) = mu(|u_tau(G)|) |R p(G)|``, where ``u(G)`` and ``p(G)`` solve Tresca's problem, friction
under the known bound G, which is convex.  Its unknowns are those of the nodes of Gamma_C with
friction, few beside those of the body.

The residual ``rho(G) = G - Phi(G)`` is semismooth.  Deflation (arXiv 1904.13299) multiplies it by
``M(G) = prod (1 + size^2/|G - G_i|^2)``, which keeps Newton's method away from the known solutions
G_i and has no other zeros.  The step of ``M rho`` is a multiple of that of ``rho``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import NotConverged
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.interior_point.family import Reaction
from contact_locking.solver.interior_point.method import InteriorPoint
from contact_locking.solver.task import LastIterate, Outcome, Task

# No bound is a smaller share of the largest, so that the friction cones have an inside.
_LEAST = 1e-12


class BoundVectors:
    """Friction bounds of all contacts as vectors (m,), the same on all ranks.

    They hold the nodes at which friction acts, rank by rank and contact by contact.  ``weights``
    (m,) are those of the nodes.  The constructor is collective.
    """

    def __init__(self, system: PenalisedSystem) -> None:
        self._comm, self._bounds = system.comm, system.bounds
        self.contacts = system.rubbing
        self._counts = [int(np.count_nonzero(item.free)) for item in self.contacts]
        sizes = self._comm.allgather(sum(self._counts))
        first = sum(sizes[: self._comm.rank])
        self._own = slice(first, first + sizes[self._comm.rank])
        self.size = sum(sizes)
        self.weights = self.gather([item.surface.weights for item in self.contacts])
        self.ones: FloatArray = np.ones(self.size)

    def gather(self, values: list[FloatArray]) -> FloatArray:
        """The vector of values at the owned nodes of each contact; collective."""
        pairs = zip(values, self.contacts, strict=True)
        return self.join([part[contact.free] for part, contact in pairs])

    def join(self, values: list[FloatArray]) -> FloatArray:
        """The vector of values at the nodes of each contact where friction acts; collective."""
        local: FloatArray = np.concatenate([*values, np.empty(0)])
        return np.concatenate(self._comm.allgather(local))

    def split(self, vector: FloatArray) -> list[FloatArray]:
        """The values of this rank at the nodes of each contact where friction acts."""
        return np.split(vector[self._own], np.cumsum(self._counts)[:-1])

    def enter(self, vector: FloatArray) -> None:
        """Let the bounds of a vector be in force; collective."""
        for contact, part in zip(self.contacts, self.split(vector), strict=True):
            bounds = np.zeros(len(contact.free))
            bounds[contact.free] = part
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
        found: tuple[FloatArray, float] = self._comm.bcast((solution, sign))
        return found


class BoundMap:
    """``G -> Phi(G)``: a Tresca problem for each value, and back-substitutions for the derivative.

    A bound that is negative counts as zero.  ``found`` is the solution of the last value, and
    ``last`` an iterate near the first, if one is known.  The constructor and all methods are
    collective.
    """

    def __init__(self, task: Task, last: LastIterate | None = None) -> None:
        self._task, self.vectors = task, BoundVectors(task.system)
        self._solver = InteriorPoint(task, bound_moves=False)
        self.found = Outcome(last=last)
        self._inside = np.ones(self.vectors.size, dtype=bool)

    def __call__(self, bounds: FloatArray) -> FloatArray:
        """``Phi(G)`` (m,); raises NotConverged where Tresca's problem is not solved."""
        system = self._task.system
        self._inside = bounds > 0.0
        used = np.maximum(bounds, 0.0)
        self.vectors.enter(np.maximum(used, _LEAST * np.max(used, initial=0.0)))
        system.u.x.array[:] = 0.0
        system.constraints.apply(system.u)
        # Along a branch the solution before is near.
        self.found = self._solver.solve(self.found.last)
        wanted = zip(self.vectors.contacts, self._pressures(), strict=True)
        return self.vectors.gather([item.friction_bound(system.u, p) for item, p in wanted])

    def pressures(self) -> FloatArray:
        """The contact pressures (m,) at the last value."""
        return self.vectors.gather(self._pressures())

    def _pressures(self) -> list[FloatArray]:
        assert self.found.multipliers is not None
        pairs = zip(self._task.system.contacts, self.found.multipliers.contacts, strict=True)
        return [item.pressure for contact, item in pairs if contact in self.vectors.contacts]

    def derivative(self) -> FloatArray:
        """``Phi'(G)`` (m, m) at the last value, by a back-substitution for each node."""
        size = self.vectors.size
        found = np.zeros((size, size))
        laws = self._solver.linearised_bounds()
        if not laws:
            return found
        for column in np.flatnonzero(self._inside):
            step = np.zeros(size)
            step[column] = 1.0
            pairs = zip(laws, self.vectors.split(step), strict=True)
            reactions = [Reaction(law.friction, law.friction.response(part)) for law, part in pairs]
            displacement = self._solver.respond(reactions)
            found[:, column] = self.vectors.join([law.moved_by(displacement) for law in laws])
        return found

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
# With deflation a step is at most so many times as long as the bounds.
_LONGEST = 1.0
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
    left: float = field(default=math.inf, init=False)

    def solve(self, start: FloatArray, deflation: Deflation | None = None) -> FloatArray | None:
        """A solution from a start, or None if none was found; collective."""
        problem, vectors = self.problem, self.problem.vectors
        known = deflation or Deflation(vectors)
        bounds = start
        found, lowest, vain = self._residual(bounds), math.inf, 0
        for _ in range(self.limit):
            if found is None or not math.isfinite(known.factor(bounds)):
                return None
            merit = known.factor(bounds) * vectors.norm(found[1])
            lowest, vain = min(merit, lowest), 0 if merit < lowest else vain + 1
            wanted, left = found
            size = max(vectors.norm(wanted), np.finfo(float).tiny)
            self.left = vectors.norm(left) / size
            if self.left <= (_ROUNDING if vain else self.tolerance):
                return None if known.is_known(bounds) else bounds
            if vain > _VAIN and not known.known:
                return None
            slope = np.eye(len(bounds)) - problem.derivative()
            step, _ = vectors.solved(slope, -left)
            if not np.all(np.isfinite(step)):
                return None
            step *= known.stretch(bounds, step)
            if known.known:
                # A line search would stay near where it begins.
                step *= min(1.0, _LONGEST * known.size / (vectors.norm(step) or 1.0))
                bounds = np.maximum(bounds + step, 0.0)
                found = self._residual(bounds)
            else:
                bounds, found = self._search(bounds, step, left)
        return None

    def _residual(self, bounds: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """``Phi(G)`` and ``G - Phi(G)``, None where Tresca's problem is not solved."""
        try:
            wanted = self.problem(bounds)
        except NotConverged:
            return None
        return wanted, bounds - wanted

    def _search(
        self, bounds: FloatArray, step: FloatArray, left: FloatArray
    ) -> tuple[FloatArray, tuple[FloatArray, FloatArray] | None]:
        """The first of shorter and shorter steps that lowers the residual, or the best of them."""
        norm, best, t, at = self.problem.vectors.norm, math.inf, 1.0, 1.0
        before = norm(left)
        for _ in range(_HALVINGS):
            trial = np.maximum(bounds + t * step, 0.0)
            found = self._residual(trial)
            if found is not None:
                merit = norm(found[1])
                if merit <= (1.0 - _DECREASE * t) * before:
                    return trial, found
                if merit < best:
                    best, at = merit, t
            t *= 0.5
        trial = np.maximum(bounds + at * step, 0.0)
        return trial, self._residual(trial)
