"""The common part of families of half lines."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.family import Family, Step


class HalfLines(Family):
    """``x = limit + compliance z - lin(u) >= 0``, ``z >= 0``, ``x z = 0``, point by point.

    What the family sees is a scalar (k,), and the reaction is z.
    """

    compliance: float
    stiffness: FloatArray
    _yielding: float
    _wanted: FloatArray
    _gap: FloatArray

    @property
    @abstractmethod
    def limit(self) -> FloatArray:
        """The largest value (k,) of what is seen."""

    def reactions_of(self, z: FloatArray) -> FloatArray:
        return z

    # The iterate.

    def speeds(self, step: Step) -> FloatArray:
        most = np.maximum(-step.primal / self.x, -step.dual / self.z)
        return np.maximum(most, 0.0)

    def primal_gap(self) -> FloatArray:
        """``limit + compliance z - lin(u) - x``."""
        return (self.limit - self.seen) + self.compliance * self.z - self.x

    # The Newton step.

    def linearise(self) -> None:
        self._gap = self.primal_gap()
        self._yielding = max(self.compliance, self.softness)
        self.stiffness = self.z / (self.x + self._yielding * self.z)

    def hold(self, stiffness: float | FloatArray) -> None:
        self.stiffness = np.full(len(self.weights), stiffness)

    def block(self, seen: FloatArray) -> FloatArray:
        return np.asarray(self.stiffness * seen)

    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        self._wanted = target - self.x * self.z
        if correction is not None:
            self._wanted -= correction
        return self.z + self._dual_step(self._gap)

    def step(self, seen: FloatArray) -> Step:
        dz = self._dual_step(self._gap - seen)
        return Step(self._yielding * dz - seen + self._gap, dz)

    def move(self, gap: FloatArray) -> None:
        self._gap, self._wanted = gap, np.zeros_like(self.z)

    def move_adjoint(self, seen: FloatArray, reactions: FloatArray) -> FloatArray:
        return -reactions

    def settle(self, product: float) -> None:
        opening, double = self.limit - self.seen, 2.0 * self.compliance
        root = np.sqrt(opening**2 + 2.0 * double * product)
        # Of two formulae for each root the one without cancellation.
        self.z = np.where(
            opening > 0.0, 2.0 * product / (root + opening), (root - opening) / double
        )
        self.x = np.asarray(product / self.z)

    def _dual_step(self, d_rest: FloatArray) -> FloatArray:
        return (self._wanted - self.z * d_rest) / (self.x + self._yielding * self.z)

    def correction(self, step: Step) -> FloatArray:
        return step.primal * step.dual

    def recentring(self, t: float, step: Step, band: tuple[float, float]) -> FloatArray:
        products = (self.x + t * step.primal) * (self.z + t * step.dual)
        return np.maximum(np.clip(products, *band) - products, -band[1])

    # Whether anything is admissible.

    def largest_multiplier(self) -> float:
        return float(self.z.max(initial=0.0))

    def holding(self, stiffness: float, largest: float) -> FloatArray:
        """Springs in proportion to the multipliers, so that small forces leave these positive."""
        return np.asarray(self.z * (stiffness / largest if largest > 0.0 else 0.0))

    def resistance(self, reactions: FloatArray) -> float:
        """``int limit z`` for ``z >= 0``."""
        if np.any(reactions < 0.0):
            return np.inf
        return float(self.weights @ (self.limit * reactions))
