"""The cones of friction under a known bound, in batches."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.cones import LorentzCones, Springs, Step
from contact_locking.solver.interior_point.lorentz import Scaling, dot, inverse

# The products at the start are at most this multiple of those of contact: a coefficient of a
# million would put them a million times apart.
_MOST = 10.0
# The rounding of a product of three or four entries, as a share of its largest summand.  A larger
# share leaves a gap that the criteria refuse where a slip is long beside the strain.
_ROUNDING = 8.0 * float(np.finfo(float).eps)


class Slips(LorentzCones):
    """``x = (t, slip, eps)`` in the cone with cost ``G t``; ``z = (G, -y, .)``.

    What is seen is the slip (d, k) along planes with the unit ``normal`` (d, k), and y the
    reaction, at most G.  The last entry of x is the length ``regularisation`` eps, absent where it
    is 0.  The bound G (k,) follows outside of the cones: a step du of the slip moves it by
    ``bound_step + growth (w . du)/w_0``, both (k,), where ``w/w_0`` is near the direction of a
    slip.
    """

    normal: FloatArray
    regularisation: float
    bound_step: FloatArray
    growth: FloatArray
    _follows: FloatArray
    _grows: FloatArray

    @property
    def _rows(self) -> slice:
        """The rows of points that belong to the slip."""
        return slice(1, 1 + len(self.normal))

    def reactions_of(self, z: FloatArray) -> FloatArray:
        return -z[self._rows]

    @property
    def bound(self) -> FloatArray:
        """G (k,)."""
        return self.z[0]

    def set_bound(self, bound: FloatArray) -> None:
        """Scale the multipliers to a bound (k,) > 0, which keeps them inside their cones."""
        self.z *= bound / self.z[0]

    # The iterate.

    def start(self, level: float, least: float) -> None:
        """Without a reaction, under a bound of 1 that :meth:`set_bound` replaces."""
        self._open(np.full(len(self.weights), max(least, self.regularisation)))
        self.z = np.zeros_like(self.x)
        self.z[0] = 1.0

    def start_under(self, bound: FloatArray, pressure: FloatArray, least: float) -> None:
        """Start under a bound (k,), with products of at most ten times those of contact."""
        share = np.minimum(_MOST * pressure / bound, 1.0)
        self._open(np.maximum(share * least, self.regularisation))
        self.set_bound(bound)

    def advance(self, t: float, step: Step) -> None:
        super().advance(t, step)
        # A normal part that rounding leaves in a long step is not small beside a slip that vanishes
        # later, and the stiffness of sticking makes a force of it.
        self.x, self.z = self.tangential(self.x), self.tangential(self.z)

    def tangential(self, values: FloatArray) -> FloatArray:
        """Points or multipliers with the parts of their vectors along the planes."""
        found = values.copy()
        found[self._rows] = along_planes(values[self._rows], self.normal)
        return found

    def least_product(self) -> float:
        """The product per volume that is rounding in a cone."""
        # In a slip that is long beside the strain of the body, G t is large beside its energy.
        return _ROUNDING * float(np.max(self.x[0] * self.z[0], initial=0.0)) / self.scale

    def _open(self, least: FloatArray) -> None:
        """Open the cones by ``least`` (k,)."""
        rest = self._fixed_rows()
        self.x = np.vstack([np.sqrt(dot(rest, rest) + least**2), rest])

    def touch(self) -> None:
        """Put the points at the boundary of their cones, above what was seen."""
        self._open(np.zeros(len(self.weights)))

    def _fixed_rows(self) -> FloatArray:
        """``(slip, eps)`` as seen."""
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
        # Where all of a foot slips, only the growth holds a body that friction alone holds.
        self.b += 2.0 * self.growth / (2.0 * w_0**2 - 1.0)
        self.w = scaling.w[self._rows]
        self._follows = 2.0 * w_0 / (2.0 * w_0**2 - 1.0) * self.w
        self._grows = self.growth / w_0 * self.w

    def set_block(self, a: FloatArray, b: FloatArray, w: FloatArray, follows: FloatArray) -> None:
        """Put ``D = a I + b w w^T`` in place of the block of the cones, without a growth.

        ``follows`` (d, k) is the change of the reaction with the bound where nothing moves.
        """
        self.a, self.b, self.w, self._follows = a, b, w, follows
        self._grows = np.zeros_like(w)

    @property
    def springs(self) -> Springs:
        """Unit tangents and the eigenvalues of D along them, that of w first."""
        along = unit_tangents(self.w, self.normal)
        found = [(along, self.a + self.b * dot(self.w, self.w))]
        if len(self.normal) == 3:
            across = np.cross(self.normal, along, axis=0).astype(float)
            found.append((across, self.a))
        return found

    @property
    def stiffest(self) -> FloatArray:
        return self.a

    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        self._aim = self._scaling.aim(target, correction)
        step = self._step(self._gap)
        return -(self.z + step.dual)[self._rows]

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
        w_rest, left = dot(w_1, d_rest), self._aim[0] - dz_0
        share = np.reciprocal(2.0 * w_0**2 - 1.0)
        d_t = (square * left + 2.0 * w_0 * w_rest) * share
        # w_0 dx_0 and w_rest cancel out: they are taken together.
        dz = np.empty_like(self.z)
        dz[0] = dz_0
        dz[1:] = self._aim[1:] - d_rest / square
        dz[1:] += (2.0 * share * (w_0 * left + w_rest / square)) * w_1
        return Step(np.vstack([d_t, d_rest]), dz)

    # The bound.

    def slip_step(self, step: Step) -> FloatArray:
        """The part (d, k) of a step that is the slip's."""
        return step.primal[self._rows]

    def grown(self, slip_step: FloatArray) -> FloatArray:
        """How far the growth moves the bound (k,) with a step (d, k) of the slip."""
        return dot(self._grows, slip_step)

    def grown_adjoint(self, bound: FloatArray) -> FloatArray:
        """The adjoint (d, k) of :meth:`grown` at a bound (k,)."""
        return np.asarray(self._grows * bound)

    def response(self, bound_step: FloatArray) -> FloatArray:
        """The change of the reaction (d, k) with the bound where nothing moves."""
        return np.asarray(self._follows * bound_step)

    def response_adjoint(self, seen: FloatArray) -> FloatArray:
        """The adjoint (k,) of :meth:`response` at what was seen (d, k)."""
        return dot(self._follows, seen)

    # The derivative by the data.

    def move(self, gap: FloatArray) -> None:
        # The stiffness of sticking enlarges a normal part that rounding leaves.
        super().move(self.tangential(gap)[1:])

    def move_adjoint(self, seen: FloatArray, reactions: FloatArray) -> FloatArray:
        rest = np.zeros_like(self.x[1:])
        rest[: len(seen)] = seen
        self.move(np.zeros_like(self.x))
        back = -self._step_under(rest, np.zeros(len(self.weights))).dual
        back[0] = 0.0
        back[self._rows] += self.grown_adjoint(self.response_adjoint(seen))
        return self.tangential(back)

    def settle(self, product: float) -> None:
        rows = self._fixed_rows()
        share = product / np.maximum(self.bound, np.finfo(float).tiny)
        self.x = np.vstack([0.5 * (share + np.sqrt(share**2 + 4.0 * dot(rows, rows))), rows])
        self.z = product * inverse(self.x)


def along_planes(vectors: FloatArray, normal: FloatArray) -> FloatArray:
    """The parts of vectors (d, k) along planes with the unit ``normal`` (d, k)."""
    # Once more, as rounding leaves a normal part that the stiffness of sticking enlarges.
    for _ in range(2):
        vectors = vectors - dot(vectors, normal) * normal
    return vectors


def unit_tangents(vectors: FloatArray, normal: FloatArray) -> FloatArray:
    """Unit vectors (d, k) along the parts of vectors in the planes, any where these vanish."""
    tangents = along_planes(vectors, normal)
    none = np.linalg.norm(tangents, axis=0) == 0.0
    axes = np.eye(len(normal))[:, np.argmin(np.abs(normal), axis=0)]
    tangents = np.where(none, along_planes(axes, normal), tangents)
    return np.asarray(tangents / np.linalg.norm(tangents, axis=0))
