"""Balls: limits of the norm of the strain."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.cones import (
    TINY,
    LorentzCones,
    Pieces,
    Springs,
    Step,
    count,
)
from contact_locking.solver.interior_point.lorentz import Scaling, dot, inverse, norm

# Newton's method for one cone only halves the distance to a double root in each step.
_MOST_STEPS = 40


class Balls(LorentzCones):
    """``x = (limit + q, lin(u))`` in the cone with cost ``q^2/(2 compliance)``; ``z = (z_0, -y)``.

    ``lin(u)`` is a vector (m, k) of norm at most ``limit`` (k,), and y is the reaction.
    ``q = compliance z_0`` is the excess; a compliance of 0 allows none.
    """

    limit: FloatArray
    compliance: float
    _share: FloatArray

    def reactions_of(self, z: FloatArray) -> FloatArray:
        return -z[1:]

    def start(self, level: float, least: float) -> None:
        radius = np.maximum(self.limit, 1.5 * norm(self.seen))
        self.x = np.vstack([radius, self.seen])
        self.z = level * self.scale * inverse(self.x)

    def primal_gap(self) -> FloatArray:
        """``(limit + q, lin(u)) - x``."""
        return np.vstack([self.limit + self.compliance * self.z[0], self.seen]) - self.x

    def sizes(self, deformation: float) -> FloatArray:
        return self.x

    # The Newton step.

    def linearise(self) -> None:
        self._gap = self.primal_gap()
        scaling = self._scaling = Scaling.of(self.x, self.z)
        kappa = self.compliance
        square, w_0 = scaling.eta**2, scaling.w[0]
        self.a = np.reciprocal(square)
        self._share = np.reciprocal(1.0 + kappa * (2.0 * w_0**2 - 1.0) * self.a)
        self.b = 2.0 * (square - kappa) * self.a**2 * self._share
        self.w = scaling.w[1:]

    @property
    def springs(self) -> Springs:
        """Along w; the rest of the block is isotropic."""
        return [(self.w, self.b)]

    @property
    def stiffest(self) -> FloatArray:
        return np.asarray(self.a + np.maximum(self.b, 0.0) * dot(self.w, self.w))

    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        self._aim = self._scaling.aim(target * self.scale, correction)
        return -(self.z + self._dual_step(self._gap[1:]))[1:]

    def step(self, seen: FloatArray) -> Step:
        d_rest = self._gap[1:] + seen
        dz = self._dual_step(d_rest)
        return Step(np.vstack([self._gap[0] + self.compliance * dz[0], d_rest]), dz)

    def _dual_step(self, d_rest: FloatArray) -> FloatArray:
        """``dz = b - W^-2 dx`` with ``dx_0 = yielding dz_0 + gap_0`` eliminated."""
        w, a, kappa = self._scaling.w, self._scaling.eta**-2, self.compliance
        w_0, w_rest, gap_0, aim_0 = w[0], dot(w[1:], d_rest), self._gap[0], self._aim[0]
        h_00, share = (2.0 * w_0**2 - 1.0) * a, self._share
        # For a large compliance w_0 dx_0 and w_rest nearly cancel, so that their sum is computed.
        along = w_0 * (gap_0 + kappa * aim_0) + (kappa * a - 1.0) * w_rest
        dz = (2.0 * share * along) * w
        dz[1:] -= d_rest
        dz *= a
        dz += self._aim
        dz[0] = (aim_0 - h_00 * gap_0 + 2.0 * a * w_0 * w_rest) * share
        return dz

    # The pieces of the law.

    def pieces(self, stiffness: float, stiffest: float) -> BallPieces:
        return BallPieces(self, stiffness, stiffest)

    # The derivative by the data.

    def move_adjoint(self, seen: FloatArray, reactions: FloatArray) -> FloatArray:
        along = dot(self.w, reactions) / (self.a + self.b * dot(self.w, self.w))
        return np.vstack([-2.0 * self.a * self._share * self._scaling.w[0] * along, reactions])

    def centre(self, product: float) -> None:
        product *= self.scale
        length, limit = norm(self.seen), self.limit
        share = self.compliance * product
        x_0 = np.maximum(length, limit) + np.sqrt(share)
        # Newton's method from above for (x_0 - limit)(x_0^2 - |seen|^2) = compliance product x_0.
        for _ in range(_MOST_STEPS):
            det = (x_0 - length) * (x_0 + length)
            value = (x_0 - limit) * det - share * x_0
            x_0 -= value / (det + 2.0 * (x_0 - limit) * x_0 - share)
        self.x = np.vstack([x_0, self.seen])
        # Beyond the limit ``z_0 = q/compliance`` has more digits than ``x^-1``.
        z_0 = np.where(
            length > limit, (x_0 - limit) / self.compliance, product * inverse(self.x)[0]
        )
        self.z = -z_0 / x_0 * self.x
        self.z[0] = z_0

    # Whether anything is admissible.

    def largest_multiplier(self) -> float:
        return float(self.z[0].max(initial=0.0))

    def resistance(self, reactions: FloatArray) -> float:
        """``int limit |y|``."""
        return float(self.weights @ (self.limit * np.linalg.norm(reactions, axis=0)))


class BallPieces(Pieces[Balls]):
    """``y = l v/|v|``, ``l = (|v| - c M)_+/(1 + c compliance)`` with ``v = y + c L eps``.

    Along v the step brings the strain to its limit; across v the direction of y follows that of the
    strain, with ``D = l/(M + compliance l)``.
    """

    def linearise(self) -> None:
        cone, (size, stress) = self.cone, self._sizes()
        self._active = stress > 0.0
        self._along = self._shifted() / np.maximum(size, TINY)
        self._across = 1.0 - stress / np.maximum(size, TINY)
        self._yielding = cone.compliance + self.softness
        a = stress / (cone.limit + cone.compliance * stress)
        cone.a, cone.w = a, self._along
        cone.b = np.where(self._active, 1.0 / self._yielding - a, 0.0)

    def evaluate(self) -> None:
        _, stress = self._sizes()
        residual = self._law(stress) - self.y
        size = dot(self._along, residual)
        share = 1.0 + self.c * self.cone.compliance
        along = share * size / (self.c * self._yielding) * self._along
        across = (residual - size * self._along) / self._across
        self.rest = np.where(self._active, along + across, residual)

    def _sizes(self) -> tuple[FloatArray, FloatArray]:
        """``|v|`` and l."""
        size = norm(self._shifted())
        excess = np.maximum(size - self.c * self.cone.limit, 0.0)
        return size, excess / (1.0 + self.c * self.cone.compliance)

    def _law(self, stress: FloatArray) -> FloatArray:
        v = self._shifted()
        return np.asarray(stress / np.maximum(norm(v), TINY) * v)

    def step(self, seen: FloatArray) -> Step:
        dy = self.rest + self.cone.block(seen)
        return Step(np.zeros_like(self.cone.x), np.vstack([np.zeros(dy.shape[1]), -dy]))

    def advance(self, step: Step) -> None:
        cone, y = self.cone, self.y - step.dual[1:]
        # A stress opposite to the strain shows a wrong piece: the point leaves its limit, and must
        # not jump to the opposite one.
        most = np.where(dot(y, cone.seen) > 0.0, np.inf, self.c * cone.limit)
        self.y = y * np.minimum(1.0, most / np.maximum(norm(y), TINY))
        _, stress = self._sizes()
        self.changed = count((stress > 0.0) != self._active)
        y = self._law(stress)
        cone.z = np.vstack([stress, -y])
        limit = cone.limit + cone.compliance * stress
        cone.x = np.vstack([limit, (self._shifted() - y) / self.c])
