"""Equations ``G = Psi(G, s)`` for friction bounds G, with a share s of friction or of loads."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.solver.equilibria.bound_map import BoundMap, BoundVectors

# The change of the share in a difference.
_WIDTH = 1e-4


class Path(Protocol):
    """The map Psi of bounds (m,) and a share, on vectors of ``vectors``; all calls are collective.

    ``problem`` has the pressures at the last value.
    """

    problem: BoundMap
    vectors: BoundVectors

    def __call__(self, bounds: FloatArray, share: float) -> FloatArray:
        """``Psi(G, s)`` (m,); raises NotConverged where Tresca's problem is not solved."""

    def slopes(self) -> tuple[FloatArray, FloatArray]:
        """The derivatives of Psi by G (m, m) and by s (m,) at the last value.

        Raises NotConverged.
        """


class OverFriction:
    """``Psi(G, s) = s Phi(G)``: the share is that of the friction coefficient."""

    def __init__(self, problem: BoundMap) -> None:
        self.problem, self.vectors = problem, problem.vectors
        self._share, self._wanted = 0.0, np.zeros(problem.vectors.size)

    def __call__(self, bounds: FloatArray, share: float) -> FloatArray:
        self._share, self._wanted = share, self.problem(bounds)
        return share * self._wanted

    def slopes(self) -> tuple[FloatArray, FloatArray]:
        return self._share * self.problem.derivative(), self._wanted


class OverLoads:
    """``Psi(G, s) = Phi(G)`` with loads for the share s, which ``put`` gives to the system."""

    def __init__(self, problem: BoundMap, put: Callable[[float], None]) -> None:
        self.problem, self.vectors, self._put = problem, problem.vectors, put
        self._bounds, self._share = np.zeros(problem.vectors.size), 1.0
        self._wanted = self._bounds

    def __call__(self, bounds: FloatArray, share: float) -> FloatArray:
        self._bounds, self._share = bounds, share
        self._wanted = self._at(share)
        return self._wanted

    def slopes(self) -> tuple[FloatArray, FloatArray]:
        by_bounds = self.problem.derivative()
        beside = self._at(self._share + _WIDTH)
        return by_bounds, np.asarray((beside - self._wanted) / _WIDTH)

    def _at(self, share: float) -> FloatArray:
        self._put(share)
        self.problem.take_loads()
        return self.problem(self._bounds)
