"""Friction cones under a friction bound G, and the pieces of their law."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.solver.interior_point.cones import (
    TINY,
    LorentzCones,
    Pair,
    Pieces,
    Springs,
    Step,
    count,
)
from contact_locking.solver.interior_point.lorentz import Scaling, dot, norm

# The largest ratio of the products at the start to those of contact, which otherwise would be as
# large as the friction coefficient.
_MOST = 10.0
# The rounding of a product of three or four entries over its largest summand.  With a larger one
# the certificate would refuse the gap of slips that are long beside the strain.
_ROUNDING = 8.0 * float(np.finfo(float).eps)
# A regularisation counts as long above this multiple of the least opening at the start, and then
# its products start at least at the second number times their summands.
_LONG, _INSIDE = 100.0, 100.0 * _ROUNDING
# Nodes with at least this share of the friction bound are assumed to keep sliding in the next step.
_SLIDES_ON = 1.0 - 1e-4
# The most Newton steps for the slip of a point, and their relative tolerance.
_MOST_STEPS, _ROUNDING_OF_SLIP = 60, 1e-15
# The bisections of an interval of logarithms.
_BISECTIONS = 60


class Slips(LorentzCones):
    """``x = (t, slip, eps)`` in the cone with cost ``G t``; ``z = (G, -y, .)``.

    ``lin(u)`` is the slip (d, k) along planes with the unit ``normal`` (d, k), and y is the
    reaction with ``|y| <= G``.  The last entry of x is the length ``regularisation`` eps, and is
    absent for eps = 0.  The bound G (k,) is updated outside of the cones: a step du of the slip
    changes it by ``bound_step + growth (w . du)/w_0``, both (k,); ``w/w_0`` approximates the
    direction of the slip.
    """

    normal: FloatArray
    regularisation: float
    bound_step: FloatArray
    growth: FloatArray
    _follows: FloatArray
    _grows: FloatArray
    _level: float

    @property
    def rows(self) -> slice:
        """The rows of x that are the slip."""
        return slice(1, 1 + len(self.normal))

    def reactions_of(self, z: FloatArray) -> FloatArray:
        return -z[self.rows]

    @property
    def bound(self) -> FloatArray:
        """G (k,)."""
        return self.z[0]

    def set_bound(self, bound: FloatArray) -> None:
        """Scale the multipliers to a bound (k,) > 0; they stay inside their cones."""
        self.z *= bound / self.z[0]

    # The iterate.

    def start(self, level: float, least: float) -> None:
        """Start without a reaction, under a bound of 1 until :meth:`start_under`."""
        self._open(np.full(len(self.weights), max(least, self.regularisation)))
        self.z, self._level = np.zeros_like(self.x), level
        self.z[0] = 1.0

    def start_under(self, bound: FloatArray, pressure: FloatArray, least: float) -> None:
        """Start under a bound (k,), with products of at most ten times those of contact."""
        if self.regularisation > _LONG * least:
            # The product of the bound and a long regularisation would take many steps to reduce.
            self.z[0], inside = bound, _INSIDE * bound * self.regularisation / self.scale
            self.centre(np.maximum(self._level, inside))
            return
        share = np.minimum(_MOST * pressure / bound, 1.0)
        self._open(np.maximum(share * least, self.regularisation))
        self.set_bound(bound)

    def advance(self, t: float, step: Step) -> None:
        super().advance(t, step)
        # Rounding in a long step leaves a normal part that may exceed a later, smaller slip, and
        # the stiffness of sticking turns it into a force.
        self.x, self.z = self.tangential(self.x), self.tangential(self.z)

    def tangential(self, values: FloatArray) -> FloatArray:
        """Points or multipliers, their vectors projected onto the planes."""
        projected = values.copy()
        projected[self.rows] = along_planes(values[self.rows], self.normal)
        return projected

    def least_product(self) -> float:
        """The largest product per volume that is only rounding."""
        # For a slip that is long beside the strain of the body, G t is large beside its energy.
        return _ROUNDING * float(np.max(self.x[0] * self.z[0], initial=0.0)) / self.scale

    def _open(self, least: FloatArray) -> None:
        """Set the points to the present slip, a distance of ``least`` (k,) inside the cones."""
        rows = self._fixed_rows()
        self.x = np.vstack([np.sqrt(dot(rows, rows) + least**2), rows])

    def touch(self) -> None:
        """Set the points to the present slip, on the boundary of the cones."""
        self._open(np.zeros(len(self.weights)))

    def _fixed_rows(self) -> FloatArray:
        """``(slip, eps)`` at the present displacement."""
        if self.regularisation == 0.0:
            return self.seen.copy()
        return np.vstack([self.seen, np.full(self.seen.shape[1], self.regularisation)])

    def primal_gap(self) -> FloatArray:
        return np.vstack([np.zeros(len(self.weights)), self._fixed_rows() - self.x[1:]])

    # The Newton step.

    def linearise(self) -> None:
        self.bound_step = np.zeros(len(self.weights))
        self._gap = self._fixed_rows() - self.x[1:]
        scaling = self._scaling = Scaling.of(self.x, self.z)
        square, w_0 = scaling.eta**2, scaling.w[0]
        self.a = np.reciprocal(square)
        self.b = -2.0 * np.reciprocal((2.0 * w_0**2 - 1.0) * square)
        # If all of Gamma_C slips, only the growth can hold a body that friction alone holds.
        self.b += 2.0 * self.growth / (2.0 * w_0**2 - 1.0)
        self.w = scaling.w[self.rows]
        self._follows = 2.0 * w_0 / (2.0 * w_0**2 - 1.0) * self.w
        self._grows = self.growth / w_0 * self.w

    def set_block(self, a: FloatArray, b: FloatArray, w: FloatArray, follows: FloatArray) -> None:
        """Set the block ``D = a I + b w w^T``, without growth of the bound.

        ``follows`` (d, k) is the derivative of the reaction by the bound for du = 0.
        """
        self.a, self.b, self.w, self._follows = a, b, w, follows
        self._grows = np.zeros_like(w)

    @property
    def springs(self) -> Springs:
        """Unit tangents and the eigenvalues of D along them, that of w first."""
        along = unit_tangents(self.w, self.normal)
        springs = [(along, self.a + self.b * dot(self.w, self.w))]
        if len(self.normal) == 3:
            across = np.cross(self.normal, along, axis=0).astype(float)
            springs.append((across, self.a))
        return springs

    @property
    def stiffest(self) -> FloatArray:
        return self.a

    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        self._aim = self._scaling.aim(target * self.scale, correction)
        step = self._step(self._gap)
        return -(self.z + step.dual)[self.rows]

    def step(self, seen: FloatArray) -> Step:
        d_rest = self._gap.copy()
        d_rest[: len(seen)] += seen
        return self._step(d_rest)

    def _step(self, d_rest: FloatArray) -> Step:
        return self._step_under(d_rest, self.bound_step + self.grown(d_rest[: len(self.normal)]))

    def _step_under(self, d_rest: FloatArray, dz_0: FloatArray) -> Step:
        """``dz = b - W^-2 dx`` with ``dz_0``, the step of the bound, solved for ``dx_0``."""
        square, w = self._scaling.eta**2, self._scaling.w
        w_0, w_1 = w[0], w[1:]
        w_rest, excess = dot(w_1, d_rest), self._aim[0] - dz_0
        share = np.reciprocal(2.0 * w_0**2 - 1.0)
        d_t = (square * excess + 2.0 * w_0 * w_rest) * share
        # w_0 dx_0 and w_rest nearly cancel, so that their sum is computed.
        dz = np.empty_like(self.z)
        dz[0] = dz_0
        dz[1:] = self._aim[1:] - d_rest / square
        dz[1:] += (2.0 * share * (w_0 * excess + w_rest / square)) * w_1
        return Step(np.vstack([d_t, d_rest]), dz)

    # The pieces of the law.

    def pieces(self, stiffness: float, stiffest: float) -> SlipPieces:
        law = SmoothSlipPieces if self.regularisation > 0.0 else SlipPieces
        return law(self, stiffness, stiffest)

    # The bound.

    def slip_step(self, step: Step) -> FloatArray:
        """The step (d, k) of the slip."""
        return step.primal[self.rows]

    def grown(self, slip_step: FloatArray) -> FloatArray:
        """The change of the bound (k,) by its growth with a step (d, k) of the slip."""
        return dot(self._grows, slip_step)

    def grown_adjoint(self, bound: FloatArray) -> FloatArray:
        """The adjoint (d, k) of :meth:`grown` at a bound (k,)."""
        return np.asarray(self._grows * bound)

    def response(self, bound_step: FloatArray) -> FloatArray:
        """The change of the reaction (d, k) with the bound for du = 0."""
        return np.asarray(self._follows * bound_step)

    def response_adjoint(self, seen: FloatArray) -> FloatArray:
        """The adjoint (k,) of :meth:`response` at a slip (d, k)."""
        return dot(self._follows, seen)

    # The derivative by the data.

    def move(self, gap: FloatArray) -> None:
        # The stiffness of sticking would amplify the rounding along the normal.
        super().move(self.tangential(gap)[1:])

    def move_adjoint(self, seen: FloatArray, reactions: FloatArray) -> FloatArray:
        rest = np.zeros_like(self.x[1:])
        rest[: len(seen)] = seen
        self.move(np.zeros_like(self.x))
        back = -self._step_under(rest, np.zeros(len(self.weights))).dual
        back[0] = 0.0
        back[self.rows] += self.grown_adjoint(self.response_adjoint(seen))
        return self.tangential(back)

    def centre(self, product: float | FloatArray) -> None:
        rows = self._fixed_rows()
        share = product * self.scale / np.maximum(self.bound, np.finfo(float).tiny)
        self.x = np.vstack([0.5 * (share + np.sqrt(share**2 + 4.0 * dot(rows, rows))), rows])
        self.z = -self.bound / self.x[0] * self.x
        self.z[0] *= -1.0


class SlipPieces(Pieces[Slips]):
    """``y = G v/max(G, |v|)`` with ``v = y + c s`` for the slip s and ``y = -sigma_tau``.

    The bound G is updated outside of this law (:mod:`bound_step`).
    """

    def __init__(self, cone: Slips, stiffness: float, stiffest: float) -> None:
        super().__init__(cone, stiffness, stiffest)
        self._slides_at = 1.0
        self._slipped: FloatArray | float = 0.0
        self._along = np.zeros_like(cone.normal)
        self._turned: BoolArray = np.zeros(len(cone.weights), dtype=bool)

    def resume(self, pair: Pair) -> None:
        # The foundation may have rotated since that solution.
        slip, traction = (along_planes(part[self.cone.rows], self.cone.normal) for part in pair)
        self.cone.z = pair[1].copy()
        self.cone.z[self.cone.rows] = traction
        self.start(self.cone.reactions)
        self._slides_at, self._slipped = _SLIDES_ON, self.c * slip

    def linearise(self) -> None:
        cone, bound = self.cone, self.cone.bound
        cone.bound_step = np.zeros_like(bound)
        v = self._shifted() + self._slipped
        size = norm(v)
        # A node that would reverse its slip in two steps in a row sticks instead.
        turns_again = self._turned & self._turns(v)
        self._turned = np.asarray(self._turns(v) & ~turns_again)
        self._sticks = np.asarray((size <= self._slides_at * bound) | turns_again)
        self._slides_at, self._slipped = 1.0, 0.0
        self._along = v / np.maximum(size, TINY)
        share = np.where(self._sticks, 0.0, bound / np.maximum(size, TINY))
        self._across = np.maximum(1.0 - share, self.c * self.softness)
        across = self.c * share / self._across
        follows = np.where(self._sticks, 0.0, self._along)
        stiffness = np.where(self._sticks, 1.0 / self.softness, across)
        cone.set_block(stiffness, np.where(self._sticks, 0.0, -across), self._along, follows)

    def evaluate(self) -> None:
        cone = self.cone
        v = self._shifted()
        residual = v * (cone.bound / np.maximum(np.maximum(cone.bound, norm(v)), TINY)) - self.y
        along = dot(self._along, residual) * self._along
        sliding = along + (residual - along) / self._across
        self.rest = np.where(self._sticks, cone.seen / self.softness, sliding)

    def _turns(self, v: FloatArray) -> BoolArray:
        """The nodes whose slip has reversed since the last tangent."""
        return np.asarray(dot(self._along, v) < 0.0)

    @property
    def aim(self) -> FloatArray:
        return super().aim + self.cone.response(self.cone.bound_step)

    def step(self, seen: FloatArray) -> Step:
        cone = self.cone
        primal, dual = np.zeros_like(cone.x), np.zeros_like(cone.z)
        primal[self.cone.rows] = seen
        dual[0] = cone.bound_step
        dual[self.cone.rows] = -(self.rest + cone.block(seen) + cone.response(cone.bound_step))
        return Step(primal, dual)

    def advance(self, step: Step) -> None:
        # The stiffness of sticking amplifies the rounding along the normal.
        self.y = along_planes(self.y - step.dual[self.cone.rows], self.cone.normal)
        self.cone.z[0] += step.dual[0]
        self.update_cones()

    def inside_under(self, bound: FloatArray, product: float) -> Pair:
        """The pair inside the cones under a bound (k,) > 0, with the same ``v = y + c s``."""
        product *= self.cone.scale
        v = self._shifted()
        size = norm(v)
        products = np.asarray(self.c * product / bound**2, dtype=float)
        below = _below_bound(size / bound, products)
        y = bound * (1.0 - below) / np.maximum(size, TINY) * v
        # The first entry of (G, -y)^-1 is G/(G^2 - y^2).
        first = product / (bound * below * (2.0 - below))
        return np.vstack([first, (v - y) / self.c]), np.vstack([bound, -y])

    def update_cones(self) -> None:
        """Limit the friction to its bound, and write points and multipliers of the cones."""
        cone, bound, v = self.cone, self.cone.bound, self._shifted()
        other = (norm(v) <= bound) != self._sticks
        self.changed = count(other | (self._turns(v) & ~self._sticks))
        y = self.y * (bound / np.maximum(np.maximum(bound, norm(self.y)), TINY))
        cone.z[self.cone.rows] = -y
        cone.touch()


class SmoothSlipPieces(SlipPieces):
    """``y = G s/sqrt(s^2 + eps^2)`` with the slip s at which ``v = y + c s``, and eps > 0.

    This is the proximal map of ``G sqrt(s^2 + eps^2)`` (22).  It is smooth, and its s lies between
    the present slip and that of the law at y, so that Newton's method takes few steps.
    """

    def linearise(self) -> None:
        cone, v = self.cone, self._shifted()
        cone.bound_step = np.zeros_like(cone.bound)
        size = norm(v)
        self._sticks = size <= cone.bound
        slip = _slip(size, cone.bound, cone.regularisation, self.c)
        reach = np.hypot(slip, cone.regularisation)
        across = cone.bound / reach
        along = across * (cone.regularisation / reach) ** 2
        self._along = v / np.maximum(size, TINY)
        softer = 1.0 + self.softness * along, 1.0 + self.softness * across
        self._shares = (1.0 + along / self.c) / softer[0], (1.0 + across / self.c) / softer[1]
        along, across = along / softer[0], across / softer[1]
        follows = slip / reach / softer[0] * self._along
        cone.set_block(across, along - across, self._along, follows)

    def evaluate(self) -> None:
        residual = self._law() - self.y
        along = dot(self._along, residual) * self._along
        self.rest = self._shares[0] * along + self._shares[1] * (residual - along)

    def _law(self) -> FloatArray:
        """``G s/sqrt(s^2 + eps^2)`` (d, k) of v."""
        cone, v = self.cone, self._shifted()
        slip = _slip(norm(v), cone.bound, cone.regularisation, self.c)
        size = cone.bound * slip / np.hypot(slip, cone.regularisation)
        return np.asarray(size / np.maximum(norm(v), TINY) * v)

    def misfit(self) -> tuple[float, float]:
        cone, residual = self.cone, self._law() - self.y
        return cone.power(residual, residual), cone.power(cone.bound, cone.bound)

    def inside_under(self, bound: FloatArray, product: float) -> Pair:
        cone = self.cone
        cone.z[0] = bound
        cone.centre(product)
        return cone.x, cone.z

    def update_cones(self) -> None:
        super().update_cones()
        y, bound = self.cone.reactions, self.cone.bound
        self.cone.z[-1] = -np.sqrt(np.maximum(bound**2 - dot(y, y), 0.0))


def _slip(size: FloatArray, bound: FloatArray, length: float, c: float) -> FloatArray:
    """The s >= 0 with ``G s/sqrt(s^2 + length^2) + c s = size``.

    The left-hand side is concave, so that Newton's method rises from a lower bound to the root.
    """
    s = np.maximum(size - bound, size / (bound / (c * length) + 1.0)) / c
    for _ in range(_MOST_STEPS):
        reach = np.hypot(s, length)
        slope = bound / reach * (length / reach) ** 2 + c
        step = (size - bound * s / reach - c * s) / slope
        s = np.maximum(s + step, 0.0)
        if np.all(np.abs(step) <= _ROUNDING_OF_SLIP * s):
            break
    return np.asarray(s)


def _below_bound(size: FloatArray, product: FloatArray) -> FloatArray:
    """The u in ``(0, 1]`` with ``(1 - u) (1 + product/(u (2 - u))) = size``."""
    # Bisect log u, because u is tiny at sliding nodes.
    least, most = np.full_like(size, np.log(TINY)), np.zeros_like(size)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (least + most)
        u = np.exp(middle)
        is_small = (1.0 - u) * (1.0 + product / (u * (2.0 - u))) > size
        least, most = np.where(is_small, middle, least), np.where(is_small, most, middle)
    return np.asarray(np.exp(0.5 * (least + most)))


def along_planes(vectors: FloatArray, normal: FloatArray) -> FloatArray:
    """Vectors (d, k) projected onto planes with the unit ``normal`` (d, k)."""
    # Twice, because the stiffness of sticking amplifies the normal part that rounding leaves.
    for _ in range(2):
        vectors = vectors - dot(vectors, normal) * normal
    return vectors


def unit_tangents(vectors: FloatArray, normal: FloatArray) -> FloatArray:
    """The directions (d, k) of projected vectors, any direction in the plane for zero."""
    tangents = along_planes(vectors, normal)
    none = np.linalg.norm(tangents, axis=0) == 0.0
    axes = np.eye(len(normal))[:, np.argmin(np.abs(normal), axis=0)]
    tangents = np.where(none, along_planes(axes, normal), tangents)
    return np.asarray(tangents / np.linalg.norm(tangents, axis=0))
