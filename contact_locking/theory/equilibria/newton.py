"""Newton's method on the map of the friction bounds, with deflation of known solutions.

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
from contact_locking.theory.equilibria.bound_map import BoundMap, BoundVectors

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
                bounds, found = self._search(bounds, step, left, known)
        return None

    def _residual(self, bounds: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """``Phi(G)`` and ``G - Phi(G)``, None where Tresca's problem is not solved."""
        try:
            wanted = self.problem(bounds)
        except NotConverged:
            return None
        return wanted, bounds - wanted

    def _search(
        self, bounds: FloatArray, step: FloatArray, left: FloatArray, known: Deflation
    ) -> tuple[FloatArray, tuple[FloatArray, FloatArray] | None]:
        """The first of shorter and shorter steps that lowers the residual, or the best of them."""
        before = known.factor(bounds) * self.problem.vectors.norm(left)
        best, t, at = math.inf, 1.0, 1.0
        for _ in range(_HALVINGS):
            trial = np.maximum(bounds + t * step, 0.0)
            found = self._residual(trial)
            if found is not None:
                merit = known.factor(trial) * self.problem.vectors.norm(found[1])
                if merit <= (1.0 - _DECREASE * t) * before:
                    return trial, found
                if merit < best:
                    best, at = merit, t
            t *= 0.5
        trial = np.maximum(bounds + at * step, 0.0)
        return trial, self._residual(trial)
