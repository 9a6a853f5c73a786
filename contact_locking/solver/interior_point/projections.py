"""The laws of the cones as semismooth equations ``y = P(y + c s)``, and Newton's step for them.

``y`` are the reactions of a family, ``s`` is how far what it sees exceeds its limit, and P is the
projection onto the reactions that the law permits (with the compliance of a penalty, its proximal
map).  The equation holds for all c > 0 or none.  Its generalised Jacobian is constant on pieces:
touching and open nodes (Hueeber, Stadler and Wohlmuth, doi:10.1137/060671061), nodes that stick and
slide, points at their limit and below.  On each piece the step of the reactions is
``dy = rest + D lin(du)``, with the block D in the place of the scaled one of the interior point
method.  A law that admits one displacement only has the stiffness 1/``softness`` instead of an
infinite one, which acts on the change of reactions and so vanishes in the end.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Generic, TypeVar

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.solver.interior_point.cones import HalfLines, Step
from contact_locking.solver.interior_point.contact_cones import FrictionCones
from contact_locking.solver.interior_point.family import Family, Reaction
from contact_locking.solver.interior_point.locking_cones import LockingCones
from contact_locking.solver.interior_point.lorentz import dot, norm
from contact_locking.solver.interior_point.slips import along_planes
from contact_locking.solver.task import Pair

_TINY = float(np.finfo(float).tiny)
# Nodes whose friction was at least this share of its bound go on to slide in the next step.
_SLIDES_ON = 1.0 - 1e-4
# Newton's steps for the slip of one point, and the share of it that is rounding.
_MOST_STEPS, _ROUNDING = 60, 1e-15
# The halvings of an interval of logarithms, to its rounding.
_BISECTIONS = 60


F = TypeVar("F", bound=Family)


class Projection(ABC, Generic[F]):
    """The semismooth equation of a family; ``stiffness`` is that of the body, a stress.

    Reactions ``y`` have the shape of what the family sees.  ``stiffest`` is how many times
    stiffer than the body a step is where its law admits one displacement only.
    """

    y: FloatArray
    rest: FloatArray
    #: How many points of this rank are on another piece than that of the block.
    changed = 0

    def __init__(self, family: F, stiffness: float, stiffest: float) -> None:
        self.family = family
        self.c = stiffness / family.scale
        self.softness = 1.0 / (stiffest * self.c)

    def start(self, reactions: FloatArray) -> None:
        """Begin with reactions."""
        self.y = reactions

    def recall(self, pair: Pair) -> None:
        """Begin with the point and the multiplier of an earlier solution."""
        self.family.z = pair[1].copy()
        self.start(self.family.reactions)

    @abstractmethod
    def linearise(self) -> None:
        """Choose the pieces by the present reactions and what was seen, and set the block D."""

    @abstractmethod
    def evaluate(self) -> None:
        """Set ``rest``, the step of the reactions if nothing moves; D may be an earlier one."""

    def extrapolate(self, displacement: FloatArray) -> None:
        """Look at another displacement, and add to ``rest`` what follows from it; collective."""
        before = self.family.seen
        self.family.look(displacement)
        self.rest += self.family.block(self.family.seen - before)

    @property
    def aim(self) -> Reaction:
        """The reactions that the step leads to if nothing moves."""
        return Reaction(self.family, self.y + self.rest)

    def misfit(self) -> float:
        """How far the reactions are from a smooth law, relative, 0 for pieces; collective."""
        return 0.0

    def _shifted(self) -> FloatArray:
        """``v = y + c s`` of what was seen."""
        return np.asarray(self.y + self.c * self.family.seen)

    @abstractmethod
    def step(self, seen: FloatArray) -> Step:
        """The step that belongs to ``lin(du)``, as one of the family."""

    @abstractmethod
    def advance(self, step: Step) -> None:
        """Take a step, once its displacement was looked at; the family gets points in its cones."""

    def inside(self, product: float) -> Pair:
        """The point and the multiplier of the family, moved inside their cones.

        Their products are ``product`` per volume, as those of an interior point method.
        """
        return inside(self.family.x, self.family.z, self.c, product * self.family.scale)


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
    along = half * w[1:] / np.maximum(length, _TINY)
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
    lower = 0.5 * square / np.maximum(root - values, _TINY)
    return np.where(values > 0.0, 0.5 * (root + values), lower)


def _below_bound(size: FloatArray, product: FloatArray) -> FloatArray:
    """The u in ``(0, 1]`` with ``(1 - u) (1 + product/(u (2 - u))) = size``."""
    # A sliding node has next to none: its logarithm is bisected.
    least, most = np.full_like(size, np.log(_TINY)), np.zeros_like(size)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (least + most)
        u = np.exp(middle)
        is_small = (1.0 - u) * (1.0 + product / (u * (2.0 - u))) > size
        least, most = np.where(is_small, middle, least), np.where(is_small, most, middle)
    return np.asarray(np.exp(0.5 * (least + most)))


class HalfLineProjection(Projection[Any]):
    """``y = max(0, y + c (lin(u) - limit))/(1 + c compliance)``; ``floor`` (>= 0) is added to D.

    The floor keeps the tangent regular where only open contact could stop a rigid motion.
    """

    def __init__(
        self, family: HalfLines, stiffness: float, stiffest: float, floor: float = 0.0
    ) -> None:
        super().__init__(family, stiffness, stiffest)
        self._floor = floor

    def linearise(self) -> None:
        family = self.family
        self._active = self._shifted() > 0.0
        self._yielding = family.compliance + self.softness
        family.stiffness = np.where(self._active, 1.0 / self._yielding, self._floor)

    def evaluate(self) -> None:
        share = 1.0 + self.c * self.family.compliance
        left = np.maximum(self._shifted(), 0.0) / share - self.y
        self.rest = np.where(self._active, share * left / (self.c * self._yielding), left)

    def _shifted(self) -> FloatArray:
        return np.asarray(self.y + self.c * (self.family.seen - self.family.limit))

    def step(self, seen: FloatArray) -> Step:
        dy = self.rest + self._active * self.family.block(seen)
        return Step(np.zeros_like(dy), dy)

    def advance(self, step: Step) -> None:
        family = self.family
        self.y = np.maximum(self.y + step.dual, 0.0)
        self.changed = _count((self._shifted() > 0.0) != self._active)
        opening = family.limit + family.compliance * self.y - family.seen
        family.z = self.y
        family.x = np.where(self.y > 0.0, 0.0, np.maximum(opening, 0.0))


class FrictionProjection(Projection[FrictionCones]):
    """``y = G v/max(G, |v|)`` with ``v = y + c s`` for the slip s and ``y = -sigma_tau``.

    The bound G follows the pressure outside of this law (:mod:`bound_step`).
    """

    def __init__(self, family: FrictionCones, stiffness: float, stiffest: float) -> None:
        super().__init__(family, stiffness, stiffest)
        self._rows = slice(1, 1 + family.nodes.dim)
        self._slides_at = 1.0
        self._slipped: FloatArray | float = 0.0
        self._along = np.zeros((family.nodes.dim, len(family.weights)))
        self._turned: BoolArray = np.zeros(len(family.weights), dtype=bool)

    def recall(self, pair: Pair) -> None:
        # The foundation may have turned since.
        slip, traction = (along_planes(part[self._rows], self.family.normal) for part in pair)
        self.family.z = pair[1].copy()
        self.family.z[self._rows] = traction
        self.start(self.family.reactions)
        self._slides_at, self._slipped = _SLIDES_ON, self.c * slip

    def linearise(self) -> None:
        family, bound = self.family, self.family.bound
        family.bound_step = np.zeros_like(bound)
        v = self._shifted() + self._slipped
        size = norm(v)
        # A node that would turn round in each step sticks instead.
        turns_again = self._turned & self._turns(v)
        self._turned = np.asarray(self._turns(v) & ~turns_again)
        self._sticks = np.asarray((size <= self._slides_at * bound) | turns_again)
        self._slides_at, self._slipped = 1.0, 0.0
        self._along = v / np.maximum(size, _TINY)
        share = np.where(self._sticks, 0.0, bound / np.maximum(size, _TINY))
        self._left = np.maximum(1.0 - share, self.c * self.softness)
        across = self.c * share / self._left
        follows = np.where(self._sticks, 0.0, self._along)
        stiffness = np.where(self._sticks, 1.0 / self.softness, across)
        family.set_block(stiffness, np.where(self._sticks, 0.0, -across), self._along, follows)

    def evaluate(self) -> None:
        family = self.family
        v = self._shifted()
        left = v * (family.bound / np.maximum(np.maximum(family.bound, norm(v)), _TINY)) - self.y
        along = dot(self._along, left) * self._along
        sliding = along + (left - along) / self._left
        self.rest = np.where(self._sticks, family.seen / self.softness, sliding)

    def _turns(self, v: FloatArray) -> BoolArray:
        """Where nodes slide against the direction of the last tangent."""
        return np.asarray(dot(self._along, v) < 0.0)

    @property
    def aim(self) -> Reaction:
        followed = self.family.response(self.family.bound_step)
        return Reaction(self.family, self.y + self.rest + followed)

    def step(self, seen: FloatArray) -> Step:
        family = self.family
        primal, dual = np.zeros_like(family.x), np.zeros_like(family.z)
        primal[self._rows] = seen
        dual[0] = family.bound_step
        dual[self._rows] = -(self.rest + family.block(seen) + family.response(family.bound_step))
        return Step(primal, dual)

    def advance(self, step: Step) -> None:
        # The stiffness of sticking enlarges the rounding along the normal.
        self.y = along_planes(self.y - step.dual[self._rows], self.family.normal)
        self.family.z[0] += step.dual[0]
        self.settle()

    def inside_under(self, bound: FloatArray, product: float) -> Pair:
        """The pair under a bound (k,) > 0: friction and slip move at the same ``v = y + c s``."""
        product *= self.family.scale
        v = self._shifted()
        size = norm(v)
        products = np.asarray(self.c * product / bound**2, dtype=float)
        below = _below_bound(size / bound, products)
        y = bound * (1.0 - below) / np.maximum(size, _TINY) * v
        # The first entry of (G, -y)^-1 is G/(G^2 - y^2).
        first = product / (bound * below * (2.0 - below))
        return np.vstack([first, (v - y) / self.c]), np.vstack([bound, -y])

    def settle(self) -> None:
        """Keep the friction within its bound, and give the family points in its cones."""
        family, bound, v = self.family, self.family.bound, self._shifted()
        other = (norm(v) <= bound) != self._sticks
        self.changed = _count(other | (self._turns(v) & ~self._sticks))
        y = self.y * (bound / np.maximum(np.maximum(bound, norm(self.y)), _TINY))
        family.z[self._rows] = -y
        family.touch()


class SmoothFrictionProjection(FrictionProjection):
    """``y = G s/sqrt(s^2 + eps^2)`` with the slip s at which ``v = y + c s``, and eps > 0.

    This is the proximal map of ``G sqrt(s^2 + eps^2)`` (22).  It is smooth, and at each y and what
    was seen it has the slip of the law between both, from which Newton's method takes few steps.
    """

    def linearise(self) -> None:
        family, v = self.family, self._shifted()
        family.bound_step = np.zeros_like(family.bound)
        size = norm(v)
        self._sticks = size <= family.bound
        slip = _slip(size, family.bound, family.regularisation, self.c)
        reach = np.hypot(slip, family.regularisation)
        across = family.bound / reach
        along = across * (family.regularisation / reach) ** 2
        self._along = v / np.maximum(size, _TINY)
        softer = 1.0 + self.softness * along, 1.0 + self.softness * across
        self._shares = (1.0 + along / self.c) / softer[0], (1.0 + across / self.c) / softer[1]
        along, across = along / softer[0], across / softer[1]
        follows = slip / reach / softer[0] * self._along
        family.set_block(across, along - across, self._along, follows)

    def evaluate(self) -> None:
        left = self._law() - self.y
        along = dot(self._along, left) * self._along
        self.rest = self._shares[0] * along + self._shares[1] * (left - along)

    def _law(self) -> FloatArray:
        """``G s/sqrt(s^2 + eps^2)`` (d, k) of v."""
        family, v = self.family, self._shifted()
        slip = _slip(norm(v), family.bound, family.regularisation, self.c)
        size = family.bound * slip / np.hypot(slip, family.regularisation)
        return np.asarray(size / np.maximum(norm(v), _TINY) * v)

    def misfit(self) -> float:
        family, left = self.family, self._law() - self.y
        squares = np.array([family.power(left, left), family.power(family.bound, family.bound)])
        miss, size = family.comm.allreduce(squares)
        return float(np.sqrt(miss / size)) if size > 0.0 else 0.0

    def inside_under(self, bound: FloatArray, product: float) -> Pair:
        family = self.family
        family.z[0] = bound
        family.settle(product * family.scale)
        return family.x, family.z

    def settle(self) -> None:
        super().settle()
        y, bound = self.family.reactions, self.family.bound
        self.family.z[-1] = -np.sqrt(np.maximum(bound**2 - dot(y, y), 0.0))


def _slip(size: FloatArray, bound: FloatArray, length: float, c: float) -> FloatArray:
    """The s >= 0 with ``G s/sqrt(s^2 + length^2) + c s = size``.

    Newton's method on a concave function goes up from a lower bound of the root.
    """
    s = np.maximum(size - bound, size / (bound / (c * length) + 1.0)) / c
    for _ in range(_MOST_STEPS):
        reach = np.hypot(s, length)
        slope = bound / reach * (length / reach) ** 2 + c
        step = (size - bound * s / reach - c * s) / slope
        s = np.maximum(s + step, 0.0)
        if np.all(np.abs(step) <= _ROUNDING * s):
            break
    return np.asarray(s)


class LockingProjection(Projection[LockingCones]):
    """``y = l v/|v|``, ``l = (|v| - c M)_+/(1 + c compliance)`` with ``v = y + c L eps``.

    Along ``v`` the strain comes to its limit; across it the direction of y follows the strain,
    ``D = l/(M + compliance l)``.
    """

    def linearise(self) -> None:
        family, (size, stress) = self.family, self._sizes()
        self._active = stress > 0.0
        self._along = self._shifted() / np.maximum(size, _TINY)
        self._across = 1.0 - stress / np.maximum(size, _TINY)
        self._yielding = family.compliance + self.softness
        a = stress / (family.limit + family.compliance * stress)
        family.a, family.w = a, self._along
        family.b = np.where(self._active, 1.0 / self._yielding - a, 0.0)

    def evaluate(self) -> None:
        _, stress = self._sizes()
        left = self._law(stress) - self.y
        size = dot(self._along, left)
        share = 1.0 + self.c * self.family.compliance
        along = share * size / (self.c * self._yielding) * self._along
        across = (left - size * self._along) / self._across
        self.rest = np.where(self._active, along + across, left)

    def _sizes(self) -> tuple[FloatArray, FloatArray]:
        """``|v|`` and l."""
        size = norm(self._shifted())
        excess = np.maximum(size - self.c * self.family.limit, 0.0)
        return size, excess / (1.0 + self.c * self.family.compliance)

    def _law(self, stress: FloatArray) -> FloatArray:
        v = self._shifted()
        return np.asarray(stress / np.maximum(norm(v), _TINY) * v)

    def step(self, seen: FloatArray) -> Step:
        dy = self.rest + self.family.block(seen)
        return Step(np.zeros_like(self.family.x), np.vstack([np.zeros(dy.shape[1]), -dy]))

    def advance(self, step: Step) -> None:
        family, y = self.family, self.y - step.dual[1:]
        # A stress that draws the strain away from its limit is that of a wrong piece: its point
        # leaves the limit, and does not go to the opposite one.
        most = np.where(dot(y, family.seen) > 0.0, np.inf, self.c * family.limit)
        self.y = y * np.minimum(1.0, most / np.maximum(norm(y), _TINY))
        _, stress = self._sizes()
        self.changed = _count((stress > 0.0) != self._active)
        y = self._law(stress)
        family.z = np.vstack([stress, -y])
        limit = family.limit + family.compliance * stress
        family.x = np.vstack([limit, (self._shifted() - y) / self.c])


def _count(marked: BoolArray) -> int:
    return int(np.count_nonzero(marked))
