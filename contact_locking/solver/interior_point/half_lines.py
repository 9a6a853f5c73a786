"""Half lines: contact, and limits of one component of the strain."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.cones import Pieces, PointCones, Springs, Step, count


class HalfLines(PointCones):
    """``x = limit + compliance z - lin(u) >= 0``, ``z >= 0``, ``x z = 0``, point by point.

    ``lin(u)`` is a scalar (k,) with the largest value ``limit`` (k,), and z is the reaction.
    """

    limit: FloatArray
    compliance: float
    stiffness: FloatArray
    _missing: FloatArray
    _gap: FloatArray

    def reactions_of(self, z: FloatArray) -> FloatArray:
        return z

    # The iterate.

    def start(self, level: float, least: float) -> None:
        self.x = np.maximum(self.limit - self.seen, least)
        self.z = np.asarray(level * self.scale / self.x)

    def speeds(self, step: Step) -> FloatArray:
        most = np.maximum(-step.primal / self.x, -step.dual / self.z)
        return np.maximum(most, 0.0)

    def primal_gap(self) -> FloatArray:
        """``limit + compliance z - lin(u) - x``."""
        return (self.limit - self.seen) + self.compliance * self.z - self.x

    # The Newton step.

    def linearise(self) -> None:
        self._gap = self.primal_gap()
        self.stiffness = self.z / (self.x + self.compliance * self.z)

    def hold(self, stiffness: float | FloatArray) -> None:
        self.stiffness = np.full(len(self.weights), stiffness)

    def block(self, seen: FloatArray) -> FloatArray:
        return np.asarray(self.stiffness * seen)

    @property
    def springs(self) -> Springs:
        return [(np.ones((1, len(self.stiffness))), self.stiffness)]

    @property
    def stiffest(self) -> FloatArray:
        return self.stiffness

    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        self._missing = target * self.scale - self.x * self.z
        if correction is not None:
            self._missing -= correction
        return self.z + self._dual_step(self._gap)

    def step(self, seen: FloatArray) -> Step:
        dz = self._dual_step(self._gap - seen)
        return Step(self.compliance * dz - seen + self._gap, dz)

    def _dual_step(self, d_rest: FloatArray) -> FloatArray:
        return (self._missing - self.z * d_rest) / (self.x + self.compliance * self.z)

    def correction(self, step: Step) -> FloatArray:
        return step.primal * step.dual

    def recentring(self, t: float, step: Step, band: tuple[float, float]) -> FloatArray:
        products = (self.x + t * step.primal) * (self.z + t * step.dual)
        low, high = (self.scale * end for end in band)
        return np.maximum(np.clip(products, low, high) - products, -high)

    # The pieces of the law.

    def pieces(self, stiffness: float, stiffest: float) -> HalfLinePieces:
        return HalfLinePieces(self, stiffness, stiffest)

    # The derivative by the data.

    def move(self, gap: FloatArray) -> None:
        self._gap, self._missing = gap, np.zeros_like(self.z)

    def move_adjoint(self, seen: FloatArray, reactions: FloatArray) -> FloatArray:
        return -reactions

    def centre(self, product: float) -> None:
        product *= self.scale
        opening, double = self.limit - self.seen, 2.0 * self.compliance
        root = np.sqrt(opening**2 + 2.0 * double * product)
        # Each root by the formula without cancellation.
        self.z = np.where(
            opening > 0.0, 2.0 * product / (root + opening), (root - opening) / double
        )
        self.x = np.asarray(product / self.z)

    # Whether anything is admissible.

    def largest_multiplier(self) -> float:
        return float(self.z.max(initial=0.0))

    def holding(self, stiffness: float, largest: float) -> FloatArray:
        """Springs proportional to the multipliers, which small forces then leave positive."""
        return np.asarray(self.z * (stiffness / largest if largest > 0.0 else 0.0))

    def resistance(self, reactions: FloatArray) -> float:
        """``int limit z`` for ``z >= 0``."""
        if np.any(reactions < 0.0):
            return np.inf
        return float(self.weights @ (self.limit * reactions))


class HalfLinePieces(Pieces[HalfLines]):
    """``y = max(0, y + c (lin(u) - limit))/(1 + c compliance)``."""

    #: A stiffness of open points, which keeps the tangent regular if only contact stops a motion.
    floor: float = 0.0

    def linearise(self) -> None:
        cone = self.cone
        self._active = self._shifted() > 0.0
        self._yielding = cone.compliance + self.softness
        cone.stiffness = np.where(self._active, 1.0 / self._yielding, self.floor)

    def evaluate(self) -> None:
        share = 1.0 + self.c * self.cone.compliance
        residual = np.maximum(self._shifted(), 0.0) / share - self.y
        self.rest = np.where(self._active, share * residual / (self.c * self._yielding), residual)

    def _shifted(self) -> FloatArray:
        return np.asarray(self.y + self.c * (self.cone.seen - self.cone.limit))

    def step(self, seen: FloatArray) -> Step:
        dy = self.rest + self._active * self.cone.block(seen)
        return Step(np.zeros_like(dy), dy)

    def advance(self, step: Step) -> None:
        cone = self.cone
        self.y = np.maximum(self.y + step.dual, 0.0)
        self.changed = count((self._shifted() > 0.0) != self._active)
        opening = cone.limit + cone.compliance * self.y - cone.seen
        cone.z = self.y
        cone.x = np.where(self.y > 0.0, 0.0, np.maximum(opening, 0.0))
