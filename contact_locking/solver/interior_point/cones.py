"""Cones in batches of k points, for the interior point method and for Newton's on pieces of laws.

At each point a cone pairs a primal point x with a multiplier z.  Their law is about ``lin(u)``,
a linear map of the displacement: a scalar (k,) or a vector (m, k).  A Newton step of the law gives
the step ``c + D lin(du)`` of the reactions on the body: the block D goes into the tangent, c into
the right-hand side, and x and z are eliminated.

The same law is also a semismooth equation (:class:`Pieces`).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.solver.interior_point.lorentz import Scaling, dot, norm

# Directions with a stiffness along each of them.
Springs: TypeAlias = list[tuple[FloatArray, FloatArray]]
# The points of cones and their multipliers.
Pair: TypeAlias = tuple[FloatArray, FloatArray]
TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Step:
    """A step of primal points and of their multipliers, in the shapes of x and z."""

    primal: FloatArray
    dual: FloatArray

    def plus(self, other: Step, share: float) -> Step:
        """The step plus ``share`` times the other."""
        return Step(self.primal + share * other.primal, self.dual + share * other.dual)


class Cone(ABC):
    """The operations of the interior point method on cones.

    Arguments ``seen`` are ``lin`` of a displacement or of its step.
    """

    #: The measure of the points that products are integrated over.
    measure: float

    # The iterate.

    @property
    @abstractmethod
    def reactions(self) -> FloatArray:
        """The reactions on the body, in the shape of ``lin(u)``."""

    @abstractmethod
    def total(self, t: float = 0.0, step: Step | None = None) -> float:
        """The complementarity products after a step of length t, weighted."""

    @abstractmethod
    def speeds(self, step: Step) -> FloatArray:
        """The reciprocal (k,) of the longest step in each cone, 0 without a limit."""

    def longest_step(self, step: Step) -> float:
        """The largest t for which all points stay in their cones, inf without a limit."""
        speed = np.max(self.speeds(step), initial=0.0)
        # A NaN has to give a length of 0.
        return np.inf if speed <= 0.0 else 1.0 / speed if speed > 0.0 else 0.0

    @abstractmethod
    def advance(self, t: float, step: Step) -> None:
        """Take a step of length t."""

    @abstractmethod
    def largest_multiplier(self) -> float:
        """The largest multiplier of a limit on the displacement, 0 without one."""

    # The Newton step.

    @abstractmethod
    def linearise(self) -> None:
        """Compute the block D at the present points and displacement."""

    @abstractmethod
    def block(self, seen: FloatArray) -> FloatArray:
        """``D lin(du)``."""

    @abstractmethod
    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        """The reactions after a step towards products of ``target`` per volume, if du = 0.

        ``correction`` is Mehrotra's second-order term of the predictor, plus recentrings.
        """

    @abstractmethod
    def step(self, seen: FloatArray) -> Step:
        """The step of points and multipliers for ``lin(du)``, towards the target of :meth:`aim`."""

    @abstractmethod
    def correction(self, step: Step) -> FloatArray:
        """The second-order term of a step."""

    @abstractmethod
    def recentring(self, t: float, step: Step, band: tuple[float, float]) -> FloatArray:
        """The correction that roughly returns products after a step t to a band per volume."""


C = TypeVar("C", bound="PointCones")


class Composite(Cone, Generic[C]):
    """Several cones as one: points, multipliers, steps and reactions are concatenated, flat."""

    def __init__(self, cones: Sequence[C]) -> None:
        self.cones = tuple(cones)
        self._points = [cone.z.shape for cone in cones]
        self._seen = [cone.reactions.shape for cone in cones]
        self.measure = sum(cone.measure for cone in cones)

    def of_points(self, values: FloatArray) -> dict[C, FloatArray]:
        """Values of points or multipliers, cone by cone."""
        return self._parts(values, self._points)

    def of_seen(self, values: FloatArray) -> dict[C, FloatArray]:
        """Values of ``lin(u)`` or of reactions, cone by cone."""
        return self._parts(values, self._seen)

    def steps(self, step: Step) -> dict[C, Step]:
        """A step, cone by cone."""
        primal, dual = self.of_points(step.primal), self.of_points(step.dual)
        return {cone: Step(primal[cone], dual[cone]) for cone in self.cones}

    def joined(self, steps: Iterable[Step]) -> Step:
        """The step of all cones from those of each."""
        parts = list(steps)
        return Step(joined(s.primal for s in parts), joined(s.dual for s in parts))

    @property
    def reactions(self) -> FloatArray:
        return joined(cone.reactions for cone in self.cones)

    def total(self, t: float = 0.0, step: Step | None = None) -> float:
        if step is None:
            return sum(cone.total() for cone in self.cones)
        return sum(cone.total(t, part) for cone, part in self.steps(step).items())

    def speeds(self, step: Step) -> FloatArray:
        return joined(cone.speeds(part) for cone, part in self.steps(step).items())

    def advance(self, t: float, step: Step) -> None:
        for cone, part in self.steps(step).items():
            cone.advance(t, part)

    def largest_multiplier(self) -> float:
        return max((cone.largest_multiplier() for cone in self.cones), default=0.0)

    def linearise(self) -> None:
        for cone in self.cones:
            cone.linearise()

    def block(self, seen: FloatArray) -> FloatArray:
        return joined(cone.block(part) for cone, part in self.of_seen(seen).items())

    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        if correction is None:
            return joined(cone.aim(target) for cone in self.cones)
        parts = self.of_points(correction)
        return joined(cone.aim(target, part) for cone, part in parts.items())

    def step(self, seen: FloatArray) -> Step:
        return self.joined(cone.step(part) for cone, part in self.of_seen(seen).items())

    def correction(self, step: Step) -> FloatArray:
        return joined(cone.correction(part) for cone, part in self.steps(step).items())

    def recentring(self, t: float, step: Step, band: tuple[float, float]) -> FloatArray:
        return joined(cone.recentring(t, part, band) for cone, part in self.steps(step).items())

    def _parts(self, values: FloatArray, shapes: Sequence[tuple[int, ...]]) -> dict[C, FloatArray]:
        ends = np.cumsum([math.prod(shape) for shape in shapes])[:-1]
        parts = zip(self.cones, np.split(values, ends), shapes, strict=False)
        return {cone: part.reshape(shape) for cone, part, shape in parts}


def joined(arrays: Iterable[FloatArray]) -> FloatArray:
    """Arrays of any shapes as one flat array."""
    return np.concatenate([np.empty(0), *(values.reshape(-1) for values in arrays)])


class PointCones(Cone):
    """Cones of one kind at k points with ``weights`` (k,).

    - ``x``, ``z``: the primal points and their multipliers
    - ``seen``: ``lin(u)`` of the present displacement, (k,) or (m, k)
    - ``scale``: 1 for products per volume, the length of the body for products per area; targets
      and means are per volume
    """

    weights: FloatArray
    scale: float = 1.0
    x: FloatArray
    z: FloatArray
    seen: FloatArray
    #: The least compliance of a step, usually 0.  It does not change the solution, because it acts
    #: on the step of the multipliers, which vanishes in the end.
    softness: float = 0.0

    @property
    def measure(self) -> float:  # type: ignore[override]
        return self.scale * float(self.weights.sum())

    @property
    def reactions(self) -> FloatArray:
        return self.reactions_of(self.z)

    @abstractmethod
    def reactions_of(self, z: FloatArray) -> FloatArray:
        """The reactions of multipliers z; they are linear in z."""

    # The iterate.

    @abstractmethod
    def start(self, level: float, least: float) -> None:
        """Start inside the cones, near the present displacement and the central path.

        ``level`` is the complementarity product per volume, ``least`` the least opening of contact.
        """

    def total(self, t: float = 0.0, step: Step | None = None) -> float:
        x, z = self.x, self.z
        if step is not None:
            x, z = x + t * step.primal, z + t * step.dual
        return self.power(x, z)

    def advance(self, t: float, step: Step) -> None:
        self.x += t * step.primal
        self.z += t * step.dual

    @abstractmethod
    def primal_gap(self) -> FloatArray:
        """The residual of the linear relation between x, z and ``lin(u)``, in the shape of x."""

    def sizes(self, deformation: float) -> FloatArray | None:
        """The scale of primal gaps, ``deformation`` for lengths; None if the gaps are zero."""
        return None

    # The block D.

    @abstractmethod
    def hold(self, stiffness: float | FloatArray) -> None:
        """Set ``D = stiffness``, a number or (k,), in place of the block of the cones."""

    @property
    @abstractmethod
    def springs(self) -> Springs:
        """Directions d (m, k) with stiffnesses c (k,), the terms ``c d d^T`` of the block D."""

    @property
    @abstractmethod
    def stiffest(self) -> FloatArray:
        """The largest eigenvalue (k,) of the block D."""

    # The pieces of the law.

    @abstractmethod
    def pieces(self, stiffness: float, stiffest: float) -> Pieces[Any]:
        """The law as a semismooth equation; arguments as for :class:`Pieces`."""

    # The derivative by the data.

    @abstractmethod
    def move(self, gap: FloatArray) -> None:
        """Make :meth:`step` the derivative by data that change the primal gap by ``gap``.

        The complementarity products stay: ``dz = -W^-2 dx``.
        """

    @abstractmethod
    def move_adjoint(self, seen: FloatArray, reactions: FloatArray) -> FloatArray:
        """The adjoint of the map from a gap to the change of reactions for du = 0.

        ``reactions`` are ``D seen``, with more digits than that product.
        """

    @abstractmethod
    def centre(self, product: float) -> None:
        """Move to the point of the central path with this product, of laws with a compliance."""

    # Whether anything is admissible.

    def largest_multiplier(self) -> float:
        return 0.0

    def power(self, reactions: FloatArray, seen: FloatArray) -> float:
        """``int reactions . lin(u)``, where ``seen`` is ``lin(u)``."""
        return float(self.weights @ dot(np.atleast_2d(reactions), np.atleast_2d(seen)))

    def resistance(self, reactions: FloatArray) -> float:
        """The largest :meth:`power` of an admissible displacement.

        Infinite for reactions of the wrong sign; zero for cones that do not limit displacements.
        """
        return 0.0

    def holding(self, stiffness: float, largest: float) -> float | FloatArray:
        """Springs, at most this stiff, that stand for the cones in a proof of infeasibility.

        ``largest`` is the largest multiplier of all families.
        """
        return stiffness


class LorentzCones(PointCones):
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
        ends = band[0] * self.scale, band[1] * self.scale
        return self._scaling.recentring(t, step.primal, step.dual, ends)

    def speeds(self, step: Step) -> FloatArray:
        return self._scaling.speeds(step.primal, step.dual)

    def move(self, gap: FloatArray) -> None:
        self._gap, self._aim = gap, np.zeros_like(self.z)

    def hold(self, stiffness: float | FloatArray) -> None:
        self.a = np.full(len(self.weights), stiffness)
        self.b, self.w = np.zeros_like(self.a), np.zeros_like(self.seen)

    def block(self, seen: FloatArray) -> FloatArray:
        return np.asarray(self.a * seen + self.b * dot(self.w, seen) * self.w)


class Pieces(ABC, Generic[C]):
    """The law of cones as a semismooth equation ``y = P(y + c s)``, and Newton's step for it.

    y are the reactions, s is the excess of ``lin(u)`` over its limit, and P is the projection onto
    the reactions that the law permits (with a compliance, its proximal map).  If the equation holds
    for one c > 0, it holds for all.  P is smooth on pieces: nodes that touch or not (Hueeber,
    Stadler and Wohlmuth, doi:10.1137/060671061), that stick or slide, points at their limit or
    below.  On each piece the step of the reactions is ``dy = rest + D lin(du)``.

    - ``stiffness``: of the body, a stress; it determines c
    - ``stiffest``: the largest stiffness of a step over that of the body, where the law itself is
      rigid; it acts on the step of the reactions, which vanishes in the end
    """

    y: FloatArray
    rest: FloatArray
    #: The number of points of this rank whose piece is no longer that of the block.
    changed = 0

    def __init__(self, cone: C, stiffness: float, stiffest: float) -> None:
        self.cone = cone
        self.c = stiffness / cone.scale
        self.softness = 1.0 / (stiffest * self.c)

    def start(self, reactions: FloatArray) -> None:
        """Start from reactions."""
        self.y = reactions

    def resume(self, pair: Pair) -> None:
        """Start from the points and multipliers of an earlier solution."""
        self.cone.z = pair[1].copy()
        self.start(self.cone.reactions)

    @abstractmethod
    def linearise(self) -> None:
        """Choose the pieces at the present reactions and displacement, and set the block D."""

    @abstractmethod
    def evaluate(self) -> None:
        """Set ``rest``, the step of the reactions for du = 0; D may be an earlier one."""

    def extrapolate(self, before: FloatArray) -> None:
        """Add to ``rest`` the effect of the change of ``lin(u)`` from ``before``."""
        self.rest += self.cone.block(self.cone.seen - before)

    @property
    def aim(self) -> FloatArray:
        """The reactions after the step, for du = 0."""
        return self.y + self.rest

    def misfit(self) -> tuple[float, float]:
        """How far the reactions are from a smooth law, and their size, squared; 0 for pieces."""
        return 0.0, 0.0

    def _shifted(self) -> FloatArray:
        """``v = y + c s`` at the present displacement."""
        return np.asarray(self.y + self.c * self.cone.seen)

    @abstractmethod
    def step(self, seen: FloatArray) -> Step:
        """The step of points and multipliers for ``lin(du)``."""

    @abstractmethod
    def advance(self, step: Step) -> None:
        """Take a step, after ``seen`` has been updated, and move the points into the cones."""

    def inside(self, product: float) -> Pair:
        """Points and multipliers inside the cones, with this product per volume."""
        return inside(self.cone.x, self.cone.z, self.c, product * self.cone.scale)


def inside(x: FloatArray, z: FloatArray, c: float, product: float) -> Pair:
    """The pair near (x, z) with ``x o z = product e``, from ``w = c x - z``; (k,) or (1 + m, k).

    With the eigenvalues l of w those of c x are ``(l + sqrt(l^2 + 4 c product))/2``.
    """
    w, square = c * x - z, 4.0 * c * product
    if w.ndim == 1:
        point = _root(w, square)
        return np.asarray(point / c), np.asarray(0.25 * square / point)
    length = norm(w[1:])
    low, high = _root(w[0] - length, square), _root(w[0] + length, square)
    half = 0.5 * (high - low)
    along = half * w[1:] / np.maximum(length, TINY)
    point = np.vstack([0.5 * (low + high), along])
    # The eigenvalues of z are the product over those of x.
    share = 0.25 * square / (low * high)
    turned = -share * point
    turned[0] *= -1.0
    return np.asarray(point / c), turned


def _root(values: FloatArray, square: float) -> FloatArray:
    """``(l + sqrt(l^2 + square))/2`` without cancellation."""
    root = np.sqrt(values**2 + square)
    # The maximum keeps the division of the branch that is not taken finite.
    lower = 0.5 * square / np.maximum(root - values, TINY)
    return np.where(values > 0.0, 0.5 * (root + values), lower)


def count(marked: BoolArray) -> int:
    """How many points are marked."""
    return int(np.count_nonzero(marked))
