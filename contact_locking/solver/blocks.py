"""The three families of cones of the contact problem, each eliminated point by point.

Every family pairs a primal point with a multiplier and eliminates both from the Newton system, so
that only the displacement is left.  With ``lin`` the part of the displacement that the family
sees (the strain of a cell, u_nu or u_tau of a node), its multiplier's step is
``c - D lin(du)``: ``D`` goes into the tangent, ``c`` into the right-hand side.

A target is what the complementarity products are driven to; ``correction`` is Mehrotra's
second-order term of the predictor.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from contact_locking.solver.cones import Lorentz, Pair, Scaling, dot, norm

FloatArray = npt.NDArray[np.float64]


# Products between these multiples of the target are left alone by a recentring.
_BAND = (0.1, 10.0)


def _band(target: float) -> tuple[float, float]:
    return _BAND[0] * target, _BAND[1] * target


class LorentzBlock:
    """What cones of any dimension share: pairs (x, z) of points in Lorentz cones, weighted."""

    x: FloatArray
    z: FloatArray
    weights: FloatArray
    _lorentz: Lorentz
    _scaling: Scaling
    _b: FloatArray

    def total(self, t: float = 0.0, step: Pair | None = None) -> float:
        """The products ``x . z`` after a step of length t, weighted, in all."""
        pair = self.x, self.z
        return self._lorentz.total(self.weights, pair, t, step or pair)

    def correction(self, dx: FloatArray, dz: FloatArray) -> FloatArray:
        """The second-order term of a step, in scaled coordinates."""
        return self._scaling.correction(dx, dz)

    def recentring(self, t: float, dx: FloatArray, dz: FloatArray, target: float) -> FloatArray:
        """What brings the scaled products after a step of length t back to ``target``, roughly."""
        return self._scaling.recentring(t, dx, dz, _band(target))

    def longest_step(self, dx: FloatArray, dz: FloatArray) -> float:
        return self._scaling.longest_step(dx, dz)

    def advance(self, t: float, dx: FloatArray, dz: FloatArray) -> None:
        self.x += t * dx
        self.z += t * dz


class LockingBlock(LorentzBlock):
    """``x = (M + q, eps) in L`` with cost ``n q^2``, cell by cell; multiplier ``z = (z_0, -Z)``.

    ``q = z_0/(2n)`` holds throughout; ``compliance = 1/(2n)`` is 0 for n = inf.  Strains and the
    locking stress Z are Mandel vectors (m, k), ``limit`` is M (k,), ``weights`` are cell volumes.
    """

    def __init__(
        self,
        lorentz: Lorentz,
        strain: FloatArray,
        limit: FloatArray,
        weights: FloatArray,
        compliance: float,
    ) -> None:
        self._lorentz = lorentz
        self.limit, self.weights, self.compliance = limit, weights, compliance
        self.x = np.vstack([np.maximum(limit, 1.5 * norm(strain)), strain])
        self.z = np.zeros_like(self.x)

    def start(self, target: float) -> None:
        """Put the multiplier on the central path: ``x o z = target e``."""
        self.z = target * self._lorentz.inverse(self.x)

    @property
    def stress(self) -> FloatArray:
        """The locking stress Z (m, k)."""
        return -self.z[1:]

    def primal_residual(self, strain: FloatArray) -> FloatArray:
        """``(M + q, eps) - x``."""
        return np.vstack([self.limit + self.compliance * self.z[0], strain]) - self.x

    def linearise(self, strain: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """``D = a I + b w w^T``: a (k,), b (k,), w (m, k); remembers the primal residual."""
        self._gap = self.primal_residual(strain)
        scaling = self._scaling = Scaling.of(self._lorentz, self.x, self.z)
        square, w_0, kappa = scaling.eta**2, scaling.w[0], self.compliance
        stiffness = np.reciprocal(square)
        share = np.reciprocal(1.0 + kappa * (2.0 * w_0**2 - 1.0) * stiffness)
        return stiffness, 2.0 * (square - kappa) * stiffness**2 * share, scaling.w[1:]

    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        """The locking stress (m, k) that the step leads to if the displacement stands still."""
        self._b = self._scaling.aim(target, correction)
        return -(self.z[1:] + self.step(None)[1][1:])

    def step(self, d_strain: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Primal and dual step for the strain's step (m, k), None for none.

        ``dz = b - W^-2 dx`` with ``dx_0 = compliance dz_0 + gap_0`` eliminated.
        """
        dx, dz = np.empty_like(self.x), np.empty_like(self.x)
        scaling, given = self._scaling, (self._b, self._gap, d_strain)
        self._lorentz.call(
            "locking_step", *dx.shape, self.compliance, scaling.eta, scaling.w, *given, dx, dz
        )
        return dx, dz


class ContactBlock:
    """``c = gap + eps p - u_nu >= 0``, ``p >= 0``, ``c p = 0``, node by node.

    ``compliance`` is the penalty parameter eps, 0 for the inequality itself.
    """

    def __init__(
        self, opening: FloatArray, weights: FloatArray, compliance: float, least: float
    ) -> None:
        self.weights, self.compliance = weights, compliance
        self.x = np.maximum(opening, least)
        self.z = np.zeros_like(self.x)

    def start(self, target: float) -> None:
        self.z = target / self.x

    def total(self, t: float = 0.0, step: Pair | None = None) -> float:
        dx, dz = step or (0.0, 0.0)
        return float(self.weights @ ((self.x + t * dx) * (self.z + t * dz)))

    def primal_residual(self, opening: FloatArray) -> FloatArray:
        """``gap + eps p - u_nu - c``, where ``opening`` is ``gap - u_nu``."""
        return opening + self.compliance * self.z - self.x

    def linearise(self, opening: FloatArray) -> FloatArray:
        """The stiffness D (k,); ``opening`` is ``gap - u_nu``; remembers the primal residual."""
        self._gap = self.primal_residual(opening)
        return self.z / (self.x + self.compliance * self.z)

    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        """The pressure (k,) that the step leads to if the displacement stands still."""
        self._wanted = target - self.x * self.z
        if correction is not None:
            self._wanted -= correction
        return self.z + self._multiplier_step(self._gap)

    def step(self, d_normal: FloatArray) -> tuple[FloatArray, FloatArray]:
        dz = self._multiplier_step(self._gap - d_normal)
        return self.compliance * dz - d_normal + self._gap, dz

    def response(self, d_normal: FloatArray) -> FloatArray:
        """The change of the pressure (k,) with the normal displacement."""
        return self.z * d_normal / (self.x + self.compliance * self.z)

    def correction(self, dx: FloatArray, dz: FloatArray) -> FloatArray:
        return dx * dz

    def recentring(self, t: float, dx: FloatArray, dz: FloatArray, target: float) -> FloatArray:
        low, high = _band(target)
        products = (self.x + t * dx) * (self.z + t * dz)
        return np.maximum(np.clip(products, low, high) - products, -high)

    def longest_step(self, dx: FloatArray, dz: FloatArray) -> float:
        speed = np.max([-dx / self.x, -dz / self.z], initial=0.0)
        return np.inf if speed <= 0.0 else 1.0 / speed if speed > 0.0 else 0.0

    def advance(self, t: float, dx: FloatArray, dz: FloatArray) -> None:
        self.x += t * dx
        self.z += t * dz

    def _multiplier_step(self, d_rest: FloatArray) -> FloatArray:
        return (self._wanted - self.z * d_rest) / (self.x + self.compliance * self.z)


class FrictionBlock(LorentzBlock):
    """``x = (t, u_tau, eps) in L`` with cost ``g t``, node by node.

    The multiplier is ``z = (g, sigma_tau, .)``.  The last entry of the primal point is the
    regularisation eps, absent where it is 0.
    """

    def __init__(
        self,
        lorentz: Lorentz,
        slip: FloatArray,
        weights: FloatArray,
        epsilon: float,
        bound: FloatArray,
        least: float,
    ) -> None:
        self._lorentz = lorentz
        self.weights, self.epsilon = weights, epsilon
        rest = self._fixed_rows(slip)
        self.x = np.vstack([np.sqrt(dot(rest, rest) + least**2), rest])
        self.z = np.zeros_like(self.x)
        self.z[0] = bound
        # How far a step is to move the bound.
        self.bound_step = np.zeros(len(bound))

    @property
    def traction(self) -> FloatArray:
        """``-sigma_tau`` (d, k)."""
        return -self.z[1 : 1 + self._dim]

    @property
    def bound(self) -> FloatArray:
        """G (k,)."""
        return self.z[0]

    def linearise(self, slip: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """``D = a I - b w w^T``: a (k,), b (k,), w (d, k); remembers the primal residual."""
        self._gap = self._fixed_rows(slip) - self.x[1:]
        scaling = self._scaling = Scaling.of(self._lorentz, self.x, self.z)
        square, w_0 = scaling.eta**2, scaling.w[0]
        factor = 2.0 * np.reciprocal((2.0 * w_0**2 - 1.0) * square)
        return np.reciprocal(square), factor, scaling.w[1 : 1 + self._dim]

    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        """``-sigma_tau`` (d, k) that the step leads to if the displacement stands still."""
        self._b = self._scaling.aim(target, correction)
        dz = self._steps(self._gap)[1]
        return -(self.z + dz)[1 : 1 + self._dim]

    def step(self, d_slip: FloatArray) -> tuple[FloatArray, FloatArray]:
        d_rest = self._gap.copy()
        d_rest[: self._dim] += d_slip
        return self._steps(d_rest)

    def response(self, bound_step: FloatArray) -> FloatArray:
        """The change of ``-sigma_tau`` (d, k) with the bound where nothing moves."""
        w = self._scaling.w
        share = 2.0 * w[0] / (2.0 * w[0] ** 2 - 1.0) * bound_step
        return np.asarray(share * w[1 : 1 + self._dim])

    def _fixed_rows(self, slip: FloatArray) -> FloatArray:
        self._dim = len(slip)
        if self.epsilon == 0.0:
            return slip.copy()
        return np.vstack([slip, np.full(slip.shape[1], self.epsilon)])

    def _steps(self, d_rest: FloatArray) -> tuple[FloatArray, FloatArray]:
        """``dz = b - W^-2 dx`` with ``dz_0 = bound_step`` solved for ``dx_0``."""
        square, w = self._scaling.eta**2, self._scaling.w
        w_0, w_1 = w[0], w[1:]
        w_rest = dot(w_1, d_rest)
        h_00 = (2.0 * w_0**2 - 1.0) / square
        d_t = (self._b[0] - self.bound_step + 2.0 * w_0 * w_rest / square) / h_00
        dz = np.empty_like(self.z)
        dz[0] = self.bound_step
        dz[1:] = self._b[1:] - (d_rest + 2.0 * (w_rest - w_0 * d_t) * w_1) / square
        return np.vstack([d_t, d_rest]), dz
