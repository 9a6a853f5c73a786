"""What families of Lorentz cones of any dimension share."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.family import Family, Step
from contact_locking.solver.interior_point.lorentz import Scaling, dot, total


class LorentzCones(Family):
    """Pairs (x, z) of points in Lorentz cones, and the block ``D = a I + b w w^T``.

    ``a`` and ``b`` are (k,), ``w`` is (m, k).
    """

    a: FloatArray
    b: FloatArray
    w: FloatArray
    _scaling: Scaling
    _aim: FloatArray
    _gap: FloatArray

    def total(self, t: float = 0.0, step: Step | None = None) -> float:
        pair = self.x, self.z
        taken = pair if step is None else (step.primal, step.dual)
        return total(self.weights, pair, t, taken)

    def correction(self, step: Step) -> FloatArray:
        return self._scaling.correction(step.primal, step.dual)

    def recentring(self, t: float, step: Step, band: tuple[float, float]) -> FloatArray:
        return self._scaling.recentring(t, step.primal, step.dual, band)

    def longest_step_between(self, step: Step, other: Step, share: float) -> float:
        return self._scaling.longest_step(step.pair, other.pair, share)

    def speeds(self, step: Step) -> FloatArray:
        return self._scaling.speeds(step.pair)

    def move(self, gap: FloatArray) -> None:
        self._gap, self._aim = gap, np.zeros_like(self.z)

    def hold(self, stiffness: float | FloatArray) -> None:
        self.a = np.full(len(self.weights), stiffness)
        self.b, self.w = np.zeros_like(self.a), np.zeros_like(self.seen)

    def block(self, seen: FloatArray) -> FloatArray:
        return np.asarray(self.a * seen + self.b * dot(self.w, seen) * self.w)
