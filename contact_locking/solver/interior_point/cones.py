"""Cones in batches: for the interior point method, and the pieces of their laws for Newton's.

A cone pairs a primal point x with a multiplier z at each of k points with weights, under a law of
what it sees of the displacement, ``lin(u)``: a scalar (k,) or a vector (m, k).  It eliminates both
from the Newton system.  The step of its reactions is ``c + D lin(du)``: the block ``D`` goes into
the tangent, ``c`` into the right-hand side.

The law of a cone is a semismooth equation as well, whose pieces :meth:`Cone.pieces` returns.
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
    """The step of the primal points of a family and of their multipliers."""

    primal: FloatArray
    dual: FloatArray

    def plus(self, other: Step, share: float) -> Step:
        """The step plus ``share`` times the other."""
        return Step(self.primal + share * other.primal, self.dual + share * other.dual)


class Cone(ABC):
    """What the interior point method does with cones, and with a :class:`Composite` of them.

    ``lin(u)`` is what they see of a displacement.
    """

    #: The measure of the points that products are integrated over.
    measure: float

    # The iterate.

    @property
    @abstractmethod
    def reactions(self) -> FloatArray:
        """The reactions on the body, in the shape of what is seen."""

    @abstractmethod
    def total(self, t: float = 0.0, step: Step | None = None) -> float:
        """The complementarity products after a step of length t, weighted."""

    @abstractmethod
    def speeds(self, step: Step) -> FloatArray:
        """The reciprocal (k,) of the longest step in each cone, 0 without a limit."""

    def longest_step(self, step: Step) -> float:
        """The largest t that leads out of no cone, inf without a limit."""
        speed = np.max(self.speeds(step), initial=0.0)
        # NaN is no direction to go in.
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
        """Make the block D of the present points and of what was seen."""

    @abstractmethod
    def block(self, seen: FloatArray) -> FloatArray:
        """``D lin(du)`` with the present block D."""

    @abstractmethod
    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        """The reactions that the step leads to if the displacement stands still.

        The complementarity products are driven to ``target`` per volume; ``correction`` is
        Mehrotra's second-order term of the predictor, with that of recentrings.
        """

    @abstractmethod
    def step(self, seen: FloatArray) -> Step:
        """The step that belongs to ``lin(du)``, towards the target that was aimed at."""

    @abstractmethod
    def correction(self, step: Step) -> FloatArray:
        """The second-order term of a step."""

    @abstractmethod
    def recentring(self, t: float, step: Step, band: tuple[float, float]) -> FloatArray:
        """The correction that brings the products after a step t back into a band, roughly.

        The band is per volume.
        """


class Composite(Cone):
    """Cones one after another.

    Points, multipliers and their steps, what is seen and reactions are flat arrays.
    """

    def __init__(self, cones: Sequence[PointCones]) -> None:
        self.cones = tuple(cones)
        self._points = [cone.z.shape for cone in cones]
        self._seen = [cone.reactions.shape for cone in cones]
        self.measure = sum(cone.measure for cone in cones)

    def of_points(self, values: FloatArray) -> list[FloatArray]:
        """Values of points or multipliers, cone by cone."""
        return _parts(values, self._points)

    def of_seen(self, values: FloatArray) -> list[FloatArray]:
        """Values of what is seen, or of reactions, cone by cone."""
        return _parts(values, self._seen)

    def steps(self, step: Step) -> list[Step]:
        """A step, cone by cone."""
        pairs = zip(self.of_points(step.primal), self.of_points(step.dual), strict=True)
        return [Step(*pair) for pair in pairs]

    def joined(self, steps: Iterable[Step]) -> Step:
        """The step of all cones from those of each."""
        parts = list(steps)
        return Step(joined(s.primal for s in parts), joined(s.dual for s in parts))

    @property
    def reactions(self) -> FloatArray:
        return joined(cone.reactions for cone in self.cones)

    def total(self, t: float = 0.0, step: Step | None = None) -> float:
        steps = [None for _ in self.cones] if step is None else self.steps(step)
        return sum(cone.total(t, part) for cone, part in zip(self.cones, steps, strict=True))

    def speeds(self, step: Step) -> FloatArray:
        return joined(cone.speeds(part) for cone, part in self._with(step))

    def advance(self, t: float, step: Step) -> None:
        for cone, part in self._with(step):
            cone.advance(t, part)

    def largest_multiplier(self) -> float:
        return max((cone.largest_multiplier() for cone in self.cones), default=0.0)

    def linearise(self) -> None:
        for cone in self.cones:
            cone.linearise()

    def block(self, seen: FloatArray) -> FloatArray:
        pairs = zip(self.cones, self.of_seen(seen), strict=True)
        return joined(cone.block(part) for cone, part in pairs)

    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        if correction is None:
            return joined(cone.aim(target) for cone in self.cones)
        pairs = zip(self.cones, self.of_points(correction), strict=True)
        return joined(cone.aim(target, part) for cone, part in pairs)

    def step(self, seen: FloatArray) -> Step:
        pairs = zip(self.cones, self.of_seen(seen), strict=True)
        return self.joined(cone.step(part) for cone, part in pairs)

    def correction(self, step: Step) -> FloatArray:
        return joined(cone.correction(part) for cone, part in self._with(step))

    def recentring(self, t: float, step: Step, band: tuple[float, float]) -> FloatArray:
        return joined(cone.recentring(t, part, band) for cone, part in self._with(step))

    def _with(self, step: Step) -> Iterable[tuple[PointCones, Step]]:
        return zip(self.cones, self.steps(step), strict=True)


def joined(arrays: Iterable[FloatArray]) -> FloatArray:
    """Arrays of any shapes as one flat array."""
    return np.concatenate([np.empty(0), *(values.reshape(-1) for values in arrays)])


def _parts(values: FloatArray, shapes: Sequence[tuple[int, ...]]) -> list[FloatArray]:
    ends = np.cumsum([math.prod(shape) for shape in shapes])[:-1]
    flat = np.split(values, ends)[: len(shapes)]
    return [part.reshape(shape) for part, shape in zip(flat, shapes, strict=True)]


class PointCones(Cone):
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
    def measure(self) -> float:  # type: ignore[override]
        return self.scale * float(self.weights.sum())

    @property
    def reactions(self) -> FloatArray:
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
        x, z = self.x, self.z
        if step is not None:
            x, z = x + t * step.primal, z + t * step.dual
        return self.power(x, z)

    def advance(self, t: float, step: Step) -> None:
        self.x += t * step.primal
        self.z += t * step.dual

    @abstractmethod
    def primal_gap(self) -> FloatArray:
        """How far the points are from their laws, in the shape of x."""

    def sizes(self, deformation: float) -> FloatArray | None:
        """The scale of gaps, which for lengths is ``deformation``; None where gaps vanish."""
        return None

    # The block D.

    @abstractmethod
    def hold(self, stiffness: float | FloatArray) -> None:
        """Put springs ``D = stiffness``, a number or (k,), in place of the cones' block."""

    @property
    @abstractmethod
    def springs(self) -> Springs:
        """Directions d, (m, k), with the stiffness c (k,) of ``c d d^T`` in the block D."""

    @property
    @abstractmethod
    def stiffest(self) -> FloatArray:
        """The largest eigenvalue (k,) of the block D."""

    # The pieces of the law.

    @abstractmethod
    def pieces(self, stiffness: float, stiffest: float) -> Pieces[Any]:
        """The law as a semismooth equation, with a body of this stiffness."""

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
    def centre(self, product: float) -> None:
        """Points of a product per volume on the central path of laws that have a compliance."""

    # Whether anything is admissible.

    def largest_multiplier(self) -> float:
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


C = TypeVar("C", bound=PointCones)


class Pieces(ABC, Generic[C]):
    """The law of cones as a semismooth equation ``y = P(y + c s)``, and Newton's step for it.

    ``y`` are the reactions, ``s`` is how far what is seen exceeds its limit, and P is the
    projection onto the reactions that the law permits (with a compliance, its proximal map).  The
    equation holds for all c > 0 or none.  Its generalised Jacobian is constant on pieces: touching
    and open nodes (Hueeber, Stadler and Wohlmuth, doi:10.1137/060671061), nodes that stick and
    slide, points at their limit and below.  On each piece the step of the reactions is
    ``dy = rest + D lin(du)``, with the block D in the place of that of the interior point method.

    ``stiffness`` is that of the body, a stress.  A law that admits one displacement only has the
    stiffness ``1/softness``, ``stiffest`` times that of the body, instead of an infinite one, which
    acts on the change of reactions and so vanishes in the end.
    """

    y: FloatArray
    rest: FloatArray
    #: How many points of this rank are on another piece than that of the block.
    changed = 0

    def __init__(self, cone: C, stiffness: float, stiffest: float) -> None:
        self.cone = cone
        self.c = stiffness / cone.scale
        self.softness = 1.0 / (stiffest * self.c)

    def start(self, reactions: FloatArray) -> None:
        """Begin with reactions."""
        self.y = reactions

    def resume(self, pair: Pair) -> None:
        """Begin with the point and the multiplier of an earlier solution."""
        self.cone.z = pair[1].copy()
        self.start(self.cone.reactions)

    @abstractmethod
    def linearise(self) -> None:
        """Choose the pieces by the present reactions and what was seen, and set the block D."""

    @abstractmethod
    def evaluate(self) -> None:
        """Set ``rest``, the step of the reactions if nothing moves; D may be an earlier one."""

    def extrapolate(self, before: FloatArray) -> None:
        """Add to ``rest`` what follows from the change since ``before`` was seen."""
        self.rest += self.cone.block(self.cone.seen - before)

    @property
    def aim(self) -> FloatArray:
        """The reactions that the step leads to if nothing moves."""
        return self.y + self.rest

    def misfit(self) -> tuple[float, float]:
        """How far the reactions are from a smooth law, and their size, squared; 0 for pieces."""
        return 0.0, 0.0

    def _shifted(self) -> FloatArray:
        """``v = y + c s`` of what was seen."""
        return np.asarray(self.y + self.c * self.cone.seen)

    @abstractmethod
    def step(self, seen: FloatArray) -> Step:
        """The step that belongs to ``lin(du)``, as one of the cones."""

    @abstractmethod
    def advance(self, step: Step) -> None:
        """Take a step, once its displacement was looked at, and put the points into the cones."""

    def inside(self, product: float) -> Pair:
        """The points and the multipliers, moved inside the cones to a product per volume."""
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
