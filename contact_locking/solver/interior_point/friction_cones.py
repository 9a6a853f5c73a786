"""The cones of friction under a known bound."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.parallel import maximum
from contact_locking.solver.interior_point.contact_nodes import ContactNodes, OnContact
from contact_locking.solver.interior_point.family import Springs, Step, dot
from contact_locking.solver.interior_point.lorentz import LorentzCones, Scaling, aligned, inverse
from contact_locking.solver.multipliers import Multipliers

# The products at the start are at most this multiple of those of contact: a coefficient of a
# million would put them a million times apart.
_MOST = 10.0
# The rounding of a product of three or four entries, as a share of its largest summand.  A larger
# share leaves a gap that the criteria refuse where a slip is long beside the strain.
_ROUNDING = 8.0 * float(np.finfo(float).eps)


class FrictionCones(OnContact, LorentzCones):
    """``x = (t, slip, eps) in L`` with cost ``G t``, node by node; ``z = (G, sigma_tau, .)``.

    The slip is that of the step, ``u_tau - u_{k-1,tau}``.  The last entry of the primal point is
    the regularisation eps, absent where it is 0.  The bound G follows the pressure outside of the
    cones; a step du of the slip moves it by ``bound_step + growth (w . du)/w_0``, both (k,), where
    ``w/w_0`` is near the direction of a slip.  ``length`` is the extent of the body.
    """

    def __init__(self, nodes: ContactNodes, regularisation: float, length: float) -> None:
        self.nodes = nodes
        self.regularisation, self.scale = regularisation, length
        self.comm, self.weights = nodes.comm, nodes.weights
        rows = 1 + nodes.dim + (regularisation > 0.0)
        self.x, self.z = np.zeros((2, rows, len(nodes.weights)))
        self.bound_step, self.growth = np.zeros((2, len(nodes.weights)))

    # The displacement and the forces.

    def see(self, displacement: FloatArray) -> FloatArray:
        return self.nodes.slips(displacement)

    def look(self, displacement: FloatArray) -> None:
        self.seen = self.nodes.increments(displacement)

    def tractions(self, reactions: FloatArray) -> FloatArray:
        return reactions

    def reactions_of(self, z: FloatArray) -> FloatArray:
        return -z[1 : 1 + self.nodes.dim]

    @property
    def bound(self) -> FloatArray:
        """G (k,)."""
        return self.z[0]

    def set_bound(self, bound: FloatArray) -> None:
        """Scale the multipliers to a bound (k,) > 0, which keeps them inside their cones."""
        self.z *= bound / self.z[0]

    # The iterate.

    def start(self, level: float, least: float) -> None:
        """Without a traction, under a bound of 1 that :meth:`set_bound` replaces."""
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
        """Points or multipliers with the parts of their vectors along the foundation."""
        found, rows = values.copy(), slice(1, 1 + self.nodes.dim)
        found[rows] = self.nodes.tangential(values[rows])
        return found

    def least_product(self) -> float:
        """The product per volume that is rounding in a cone of this rank."""
        # In a slip that is long beside the strain of the body, G t is large beside its energy.
        return _ROUNDING * float(np.max(self.x[0] * self.z[0], initial=0.0)) / self.scale

    def _open(self, least: FloatArray) -> None:
        """Open the cones by ``least`` (k,)."""
        rest = self._fixed_rows()
        self.x = np.vstack([np.sqrt(dot(rest, rest) + least**2), rest])

    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        self.nodes.enter(self.reactions, multipliers.contacts[self.nodes.number].friction)

    def _fixed_rows(self) -> FloatArray:
        """``(slip, eps)`` as seen."""
        if self.regularisation == 0.0:
            return self.seen.copy()
        return np.vstack([self.seen, np.full(self.seen.shape[1], self.regularisation)])

    # The Newton step.

    def linearise(self) -> None:
        self.bound_step = np.zeros(len(self.weights))
        self._gap = self._rows_gap()
        scaling = self._scaling = Scaling.of(self.x, self.z)
        square, w_0 = scaling.eta**2, scaling.w[0]
        self.a = np.reciprocal(square)
        self.b = -2.0 * np.reciprocal((2.0 * w_0**2 - 1.0) * square)
        # Where all of a foot slips, only the growth holds a body that friction alone holds.
        self.b += 2.0 * self.growth / (2.0 * w_0**2 - 1.0)
        self.w = scaling.w[1 : 1 + self.nodes.dim]
        self._follows = 2.0 * w_0 / (2.0 * w_0**2 - 1.0) * self.w
        self._grows = self.growth / w_0 * self.w

    def set_block(self, a: FloatArray, b: FloatArray, w: FloatArray, follows: FloatArray) -> None:
        """Put ``D = a I + b w w^T`` in place of the block of the cones, without a growth.

        ``follows`` (d, k) is the change of ``-sigma_tau`` with the bound where nothing moves.
        """
        self.a, self.b, self.w, self._follows = a, b, w, follows
        self._grows = np.zeros_like(w)

    def touch(self) -> None:
        """Put the points at the boundary of their cones, above what was seen."""
        self._open(np.zeros(len(self.weights)))

    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        self._aim = self._scaling.aim(target, correction)
        step = self._step(self._gap)
        return -(self.z + step.dual)[1 : 1 + self.nodes.dim]

    def step(self, seen: FloatArray) -> Step:
        d_rest = self._gap.copy()
        d_rest[: self.nodes.dim] += seen
        return self._step(d_rest)

    def slip_step(self, step: Step) -> FloatArray:
        """The part (d, k) of a step that is the slip's."""
        return step.primal[1 : 1 + self.nodes.dim]

    def grown(self, slip_step: FloatArray) -> FloatArray:
        """How far the growth moves the bound (k,) with a step (d, k) of the slip."""
        return dot(self._grows, slip_step)

    def response(self, bound_step: FloatArray) -> FloatArray:
        """The change of ``-sigma_tau`` (d, k) with the bound where nothing moves."""
        return np.asarray(self._follows * bound_step)

    def response_adjoint(self, seen: FloatArray) -> FloatArray:
        """The adjoint (k,) of :meth:`response` at what was seen (d, k)."""
        return dot(self._follows, seen)

    def grown_adjoint(self, bound: FloatArray) -> FloatArray:
        """The adjoint (d, k) of :meth:`grown` at a bound (k,)."""
        return np.asarray(self._grows * bound)

    def centred(self, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        # Data that turn the normal of a foundation turn slips and tractions with it.
        x, z = self.tangential(x), self.tangential(z)
        slips, bounds = (values[0] / (maximum(self.comm, values[0]) or 1.0) for values in (x, z))
        return aligned(x, z, slips >= bounds)

    def primal_gap(self) -> FloatArray:
        return np.vstack([np.zeros(len(self.weights)), self._rows_gap()])

    def _rows_gap(self) -> FloatArray:
        return self._fixed_rows() - self.x[1:]

    def move(self, gap: FloatArray) -> None:
        # The stiffness of sticking enlarges a normal part that rounding leaves.
        super().move(self.tangential(gap)[1:])

    def move_adjoint(self, seen: FloatArray, reactions: FloatArray) -> FloatArray:
        rest, dim = np.zeros_like(self.x[1:]), self.nodes.dim
        rest[:dim] = seen
        self.move(np.zeros_like(self.x))
        back = -self._step_under(rest, np.zeros(len(self.weights))).dual
        back[0] = 0.0
        back[1 : 1 + dim] += self.grown_adjoint(self.response_adjoint(seen))
        return self.tangential(back)

    def settle(self, product: float) -> None:
        rows = self._fixed_rows()
        share = product / np.maximum(self.bound, np.finfo(float).tiny)
        self.x = np.vstack([0.5 * (share + np.sqrt(share**2 + 4.0 * dot(rows, rows))), rows])
        self.z = product * inverse(self.x)

    def _step(self, d_rest: FloatArray) -> Step:
        return self._step_under(d_rest, self.bound_step + self.grown(d_rest[: self.nodes.dim]))

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

    # The start.

    def pull(self, stiffness: float) -> FloatArray:
        """Springs rest where the nodes stood before the step."""
        return -stiffness * self.nodes.old_slips()

    # The tangent.

    def write_block(self) -> None:
        self._write(self.a, self.b, self.w)

    def _write(self, a: FloatArray, b: FloatArray, w: FloatArray) -> None:
        normal, w = self.nodes.normal, self.nodes.tangential(w)
        across = np.eye(self.nodes.dim)[:, :, None] - normal[:, None] * normal
        self.tangent_block = a * across + b * w[:, None] * w

    @property
    def stiffest(self) -> FloatArray:
        return self.a

    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        first, rest = stiffness[0], stiffness[-1]
        self._write(rest, first - rest, self.springs[0][0])

    @property
    def springs(self) -> Springs:
        """Unit tangents and the eigenvalues of D along them, that of w first."""
        along = self.nodes.unit_tangents(self.w)
        found = [(along, self.a + self.b * dot(self.w, self.w))]
        if self.nodes.dim == 3:
            across = np.cross(self.nodes.normal, along, axis=0).astype(float)
            found.append((across, self.a))
        return found
