"""The cones of the interior point method, in batches: half lines and balls.

A cone pairs a primal point x with a multiplier z at each of k points with weights, under a law of
what it sees of the displacement, ``lin(u)``: a scalar (k,) or a vector (m, k).  It eliminates both
from the Newton system.  The step of its reactions is ``c + D lin(du)``: the block ``D`` goes into
the tangent, ``c`` into the right-hand side.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.lorentz import Scaling, dot, inverse, norm

# Directions with a stiffness along each of them.
Springs: TypeAlias = list[tuple[FloatArray, FloatArray]]
# Newton's method for one cone halves the distance to a double root, and else is fast.
_MOST_STEPS = 40


@dataclass(frozen=True)
class Step:
    """The step of the primal points of a family and of their multipliers."""

    primal: FloatArray
    dual: FloatArray

    def plus(self, other: Step, share: float) -> Step:
        """The step plus ``share`` times the other."""
        return Step(self.primal + share * other.primal, self.dual + share * other.dual)


class Cone(ABC):
    """Cones of one kind at k points with weights.

    ``x`` and ``z`` are the primal points and their multipliers, and ``seen`` is what they see of a
    displacement.  ``scale`` is 1 where products are per volume, and the length of the body where
    they are per area: means and targets are per volume.
    """

    weights: FloatArray
    scale: float = 1.0
    x: FloatArray
    z: FloatArray
    seen: FloatArray
    #: The least compliance of a step, 0 for the step of the cones as they are.  The laws of the
    #: iterate do not have it: it acts on the change of multipliers, which vanishes in the end.
    softness: float = 0.0

    @property
    def reactions(self) -> FloatArray:
        """The reactions on the body, in the shape of what is seen."""
        return self.reactions_of(self.z)

    @abstractmethod
    def reactions_of(self, z: FloatArray) -> FloatArray:
        """The reactions of multipliers, in which they are linear."""

    # The iterate.

    @abstractmethod
    def start(self, level: float, least: float) -> None:
        """Points inside the cones near what was seen, on the central path or near it.

        ``level`` is the complementarity product per volume, ``least`` the least opening of contact.
        """

    def total(self, t: float = 0.0, step: Step | None = None) -> float:
        """The complementarity products after a step of length t, weighted."""
        x, z = self.x, self.z
        if step is not None:
            x, z = x + t * step.primal, z + t * step.dual
        return self.power(x, z)

    @abstractmethod
    def speeds(self, step: Step) -> FloatArray:
        """The reciprocal (k,) of the longest step in each cone, 0 without a limit."""

    def longest_step(self, step: Step) -> float:
        """The largest t that leads out of no cone, inf without a limit."""
        speed = np.max(self.speeds(step), initial=0.0)
        # NaN is no direction to go in.
        return np.inf if speed <= 0.0 else 1.0 / speed if speed > 0.0 else 0.0

    def advance(self, t: float, step: Step) -> None:
        """Take a step of length t."""
        self.x += t * step.primal
        self.z += t * step.dual

    @abstractmethod
    def primal_gap(self) -> FloatArray:
        """How far the points are from their laws, in the shape of x."""

    def sizes(self, deformation: float) -> FloatArray | None:
        """The scale of gaps, which for lengths is ``deformation``; None where gaps vanish."""
        return None

    # The Newton step.

    @abstractmethod
    def linearise(self) -> None:
        """Make the block D of the present points and of what was seen."""

    @abstractmethod
    def hold(self, stiffness: float | FloatArray) -> None:
        """Put springs ``D = stiffness``, a number or (k,), in place of the cones' block."""

    @abstractmethod
    def block(self, seen: FloatArray) -> FloatArray:
        """``D lin(du)`` with the present block D."""

    @property
    @abstractmethod
    def springs(self) -> Springs:
        """Directions d, (m, k), with the stiffness c (k,) of ``c d d^T`` in the block D."""

    @property
    @abstractmethod
    def stiffest(self) -> FloatArray:
        """The largest eigenvalue (k,) of the block D."""

    @abstractmethod
    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        """The reactions that the step leads to if the displacement stands still.

        The complementarity products are driven to ``target``; ``correction`` is Mehrotra's
        second-order term of the predictor, with that of recentrings.
        """

    @abstractmethod
    def step(self, seen: FloatArray) -> Step:
        """The step that belongs to ``lin(du)``, towards the target that was aimed at."""

    @abstractmethod
    def correction(self, step: Step) -> FloatArray:
        """The second-order term of a step."""

    @abstractmethod
    def recentring(self, t: float, step: Step, band: tuple[float, float]) -> FloatArray:
        """The correction that brings the products after a step t back into a band, roughly."""

    # The derivative by the data.

    @abstractmethod
    def move(self, gap: FloatArray) -> None:
        """Let steps be the change with data that move the points by ``gap``, in the shape of x.

        The complementarity products stay: ``dz = -W^-2 dx``.
        """

    @abstractmethod
    def move_adjoint(self, seen: FloatArray, reactions: FloatArray) -> FloatArray:
        """The adjoint of the map from a gap to the reactions that change if nothing moves.

        ``reactions`` are ``D seen``, with digits that ``seen`` has not.
        """

    @abstractmethod
    def settle(self, product: float) -> None:
        """Points of a ``product`` on the central path of the laws, which have a compliance."""

    # Whether anything is admissible.

    def largest_multiplier(self) -> float:
        """The largest multiplier of a limit on the displacement."""
        return 0.0

    def power(self, reactions: FloatArray, seen: FloatArray) -> float:
        """``int reactions . lin(u)`` of given reactions and ``lin(u)``."""
        return float(self.weights @ dot(np.atleast_2d(reactions), np.atleast_2d(seen)))

    def resistance(self, reactions: FloatArray) -> float:
        """The most that :meth:`power` can be where the displacement is admissible.

        Infinite for reactions that the limit has not; zero for cones that do not limit it.
        """
        return 0.0

    def holding(self, stiffness: float, largest: float) -> float | FloatArray:
        """Springs of this stiffness at most, whose forces may change the present reactions.

        ``largest`` is the largest multiplier of all families.
        """
        return stiffness


class HalfLines(Cone):
    """``x = limit + compliance z - lin(u) >= 0``, ``z >= 0``, ``x z = 0``, point by point.

    What is seen is a scalar (k,), and the reaction is z.  ``limit`` (k,) is its largest value.
    """

    limit: FloatArray
    compliance: float
    stiffness: FloatArray
    _yielding: float
    _wanted: FloatArray
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
        self._yielding = max(self.compliance, self.softness)
        self.stiffness = self.z / (self.x + self._yielding * self.z)

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
        self._wanted = target - self.x * self.z
        if correction is not None:
            self._wanted -= correction
        return self.z + self._dual_step(self._gap)

    def step(self, seen: FloatArray) -> Step:
        dz = self._dual_step(self._gap - seen)
        return Step(self._yielding * dz - seen + self._gap, dz)

    def _dual_step(self, d_rest: FloatArray) -> FloatArray:
        return (self._wanted - self.z * d_rest) / (self.x + self._yielding * self.z)

    def correction(self, step: Step) -> FloatArray:
        return step.primal * step.dual

    def recentring(self, t: float, step: Step, band: tuple[float, float]) -> FloatArray:
        products = (self.x + t * step.primal) * (self.z + t * step.dual)
        return np.maximum(np.clip(products, *band) - products, -band[1])

    # The derivative by the data.

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


class LorentzCones(Cone):
    """Pairs (x, z) of points in Lorentz cones, and the block ``D = a I + b w w^T``.

    ``a`` and ``b`` are (k,), ``w`` is (m, k).
    """

    a: FloatArray
    b: FloatArray
    w: FloatArray
    _scaling: Scaling
    _aim: FloatArray
    _gap: FloatArray

    def correction(self, step: Step) -> FloatArray:
        return self._scaling.correction(step.primal, step.dual)

    def recentring(self, t: float, step: Step, band: tuple[float, float]) -> FloatArray:
        return self._scaling.recentring(t, step.primal, step.dual, band)

    def speeds(self, step: Step) -> FloatArray:
        return self._scaling.speeds(step.primal, step.dual)

    def move(self, gap: FloatArray) -> None:
        self._gap, self._aim = gap, np.zeros_like(self.z)

    def hold(self, stiffness: float | FloatArray) -> None:
        self.a = np.full(len(self.weights), stiffness)
        self.b, self.w = np.zeros_like(self.a), np.zeros_like(self.seen)

    def block(self, seen: FloatArray) -> FloatArray:
        return np.asarray(self.a * seen + self.b * dot(self.w, seen) * self.w)


class Balls(LorentzCones):
    """``x = (limit + q, lin(u))`` in the cone with cost ``q^2/(2 compliance)``; ``z = (z_0, -y)``.

    What is seen is a vector (m, k), whose norm is ``limit`` (k,) at most, and y is the reaction.
    ``q = compliance z_0`` holds throughout; with a compliance of 0 nothing exceeds the limit.
    """

    limit: FloatArray
    compliance: float
    _yielding: float
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
        kappa = self._yielding = max(self.compliance, self.softness)
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
        self._aim = self._scaling.aim(target, correction)
        return -(self.z + self._dual_step(self._gap[1:]))[1:]

    def step(self, seen: FloatArray) -> Step:
        d_rest = self._gap[1:] + seen
        dz = self._dual_step(d_rest)
        return Step(np.vstack([self._gap[0] + self._yielding * dz[0], d_rest]), dz)

    def _dual_step(self, d_rest: FloatArray) -> FloatArray:
        """``dz = b - W^-2 dx`` with ``dx_0 = yielding dz_0 + gap_0`` eliminated."""
        w, a, kappa = self._scaling.w, self._scaling.eta**-2, self._yielding
        w_0, w_rest, gap_0, aim_0 = w[0], dot(w[1:], d_rest), self._gap[0], self._aim[0]
        h_00, share = (2.0 * w_0**2 - 1.0) * a, self._share
        # Where the compliance is soft beside the cone, w_0 dx_0 and w_rest cancel out: they are
        # taken together.
        along = w_0 * (gap_0 + kappa * aim_0) + (kappa * a - 1.0) * w_rest
        dz = (2.0 * share * along) * w
        dz[1:] -= d_rest
        dz *= a
        dz += self._aim
        dz[0] = (aim_0 - h_00 * gap_0 + 2.0 * a * w_0 * w_rest) * share
        return dz

    # The derivative by the data.

    def move_adjoint(self, seen: FloatArray, reactions: FloatArray) -> FloatArray:
        along = dot(self.w, reactions) / (self.a + self.b * dot(self.w, self.w))
        return np.vstack([-2.0 * self.a * self._share * self._scaling.w[0] * along, reactions])

    def settle(self, product: float) -> None:
        length, limit = norm(self.seen), self.limit
        share = self.compliance * product
        x_0 = np.maximum(length, limit) + np.sqrt(share)
        # Newton's method from above on (x_0 - limit)(x_0^2 - |seen|^2) = compliance product x_0.
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
