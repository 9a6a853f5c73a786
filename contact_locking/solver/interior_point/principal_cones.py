"""The cones of a limit of the largest principal strain in the plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray
from contact_locking.laws.elasticity import mandel_vector
from contact_locking.solver.interior_point.family import Springs, Step
from contact_locking.solver.interior_point.limits_of_strain import StrainCones
from contact_locking.solver.interior_point.lorentz import Scaling, inverse, norm
from contact_locking.solver.interior_point.strain_operator import StrainOperator

# From Mandel vectors (xx, yy, xy) to (tr/sqrt(2), (xx - yy)/sqrt(2), sqrt(2) xy), a rotation: a
# tensor has no negative eigenvalue if these three are in the Lorentz cone.
TURN = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, math.sqrt(2.0)]]) / math.sqrt(2.0)


@dataclass(frozen=True)
class Frame:
    """The eigenvectors of ``y -> p y p`` and the like for points p of a Lorentz cone in R^3.

    They are ``(1, v)/sqrt(2)``, ``(1, -v)/sqrt(2)`` and across both, for unit vectors v ``along``
    (2, k).
    """

    along: FloatArray

    @classmethod
    def of(cls, points: FloatArray) -> Frame:
        """The frame of points (3, k); any one for multiples of (1, 0, 0)."""
        length = norm(points[1:])
        is_turned = length > 0.0
        along = points[1:] / np.where(is_turned, length, 1.0)
        return cls(np.where(is_turned, along, np.array([[1.0], [0.0]])))

    @property
    def vectors(self) -> FloatArray:
        """The three vectors (3, 3, k), the number of the vector first."""
        one, (a, b) = np.ones_like(self.along[0]), self.along
        root = math.sqrt(0.5)
        first, second = root * np.array([one, a, b]), root * np.array([one, -a, -b])
        return np.array([first, second, [0.0 * one, -b, a]])

    def apply(self, factors: FloatArray, y: FloatArray) -> FloatArray:
        """``sum factors_i (e_i . y) e_i`` (3, k) over the vectors e_i, with factors (3, k)."""
        vectors = self.vectors
        return np.einsum("ijk,ik->jk", vectors, factors * np.einsum("ijk,jk->ik", vectors, y))


class PrincipalCones(StrainCones):
    """``x = sqrt(2) M e + q - T eps`` in the cone with cost ``n |q|^2``, and z in the cone.

    T eps are the three numbers of ``TURN`` and ``e = (1, 0, 0)``, so that x are those of the tensor
    ``M I - eps`` with the eigenvalues ``M - eps_I`` and ``M - eps_II``.  ``q = z/(2n)`` holds
    throughout.  The multiplier is the tensor y with ``T y = z``.  The block is
    ``D = T^T (sum d_i e_i e_i^T) T`` with the vectors of ``frame`` and ``factors`` d (3, k).
    """

    frame: Frame
    factors: FloatArray

    def __init__(self, strains: StrainOperator, compliance: float, number: int) -> None:
        super().__init__(strains, compliance, number)
        self.x, self.z = np.zeros((2, 3, len(strains.limit)))

    def reactions_of(self, z: FloatArray) -> FloatArray:
        return np.asarray(TURN.T @ z)

    @property
    def reach(self) -> FloatArray:
        turned = TURN @ self.seen
        return np.asarray((turned[0] + norm(turned[1:])) / math.sqrt(2.0))

    def by_limit(self, gaps: FloatArray) -> FloatArray:
        return math.sqrt(2.0) * super().by_limit(gaps)

    @property
    def room(self) -> FloatArray:
        """``sqrt(2) M e - T eps``, the numbers of ``M I - eps``."""
        found = -(TURN @ self.seen)
        found[0] += math.sqrt(2.0) * self.limit
        return np.asarray(found)

    @property
    def penalised(self) -> FloatArray:
        room = self.room
        length = norm(room[1:])
        high, low = np.maximum(length - room[0], 0.0), np.maximum(-length - room[0], 0.0)
        z = np.vstack([high + low, (low - high) * Frame.of(room).along])
        return self.reactions_of(0.5 / self.compliance * z)

    # The iterate.

    def start(self, level: float, least: float) -> None:
        self.x = -(TURN @ self.seen)
        self.x[0] += math.sqrt(2.0) * np.maximum(self.limit, 1.5 * self.reach)
        self.z = level * inverse(self.x)

    def primal_residual(self, deformation: float) -> float:
        # Beside the limit and the strain: x itself is zero where both principal strains are M.
        return self.relative_gap(self.limit + norm(self.seen))

    def primal_gap(self) -> FloatArray:
        """``sqrt(2) M e + q - T eps - x``."""
        return np.asarray(self.room + self.compliance * self.z - self.x)

    # The Newton step.

    def linearise(self) -> None:
        self._gap = self.primal_gap()
        scaling = self._scaling = Scaling.of(self.x, self.z)
        self._yielding = max(self.compliance, self.softness)
        self.frame = Frame.of(scaling.w)
        stretch = (scaling.w[0] + norm(scaling.w[1:])) ** 2
        # The eigenvalues of W^2 in the frame.
        self._square = scaling.eta**2 * np.array([stretch, 1.0 / stretch, np.ones_like(stretch)])
        self.factors = 1.0 / (self._square + self._yielding)

    def hold(self, stiffness: float | FloatArray) -> None:
        count = len(self.weights)
        self.frame = Frame.of(np.zeros((3, count)))
        self.factors = np.broadcast_to(stiffness, (3, count)).copy()

    def block(self, seen: FloatArray) -> FloatArray:
        return np.asarray(TURN.T @ self.frame.apply(self.factors, TURN @ seen))

    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        self._aim = self._scaling.aim(target, correction)
        return self.reactions_of(self.z + self._dual_step(self._gap))

    def step(self, seen: FloatArray) -> Step:
        rest = self._gap - TURN @ seen
        dz = self._dual_step(rest)
        return Step(rest + self._yielding * dz, dz)

    def move_adjoint(self, seen: FloatArray) -> FloatArray:
        return -self.frame.apply(self.factors, TURN @ seen)

    def _dual_step(self, rest: FloatArray) -> FloatArray:
        """``dz = b - W^-2 dx`` with ``dx = rest + yielding dz`` eliminated."""
        aimed = self.frame.apply(self._square * self.factors, self._aim)
        return aimed - self.frame.apply(self.factors, rest)

    def settle(self, product: float) -> None:
        room = self.room
        length = norm(room[1:])
        # x^2 - room x = compliance product for the eigenvalues, without cancellation.
        eigenvalues = np.array([room[0] + length, room[0] - length])
        square = 4.0 * self.compliance * product
        root = np.sqrt(eigenvalues**2 + square)
        first, second = np.where(
            eigenvalues > 0.0,
            0.5 * (root + eigenvalues),
            0.5 * square / np.where(eigenvalues > 0.0, 1.0, root - eigenvalues),
        )
        along = Frame.of(room).along
        self.x = np.vstack([0.5 * (first + second), 0.5 * (first - second) * along])
        high, low = product / second, product / first
        self.z = np.vstack([0.5 * (high + low), -0.5 * (high - low) * along])

    # The tangent.

    def tangent_term(self, v: Expr, du: Expr) -> Expr:
        """``int (D m(eps(du))) . m(eps(v))`` with Mandel vectors m."""
        places = self._strains
        self._matrix = fem.Function(places.matrices)
        eps, eps_v = (mandel_vector(places.strain(w)) for w in (du, v))
        return ufl.inner(ufl.dot(self._matrix, eps), eps_v) * places.dx

    @property
    def springs(self) -> Springs:
        vectors = np.einsum("ab,ibk->iak", TURN.T, self.frame.vectors)
        return list(zip(vectors, self.factors, strict=True))

    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        vectors = np.array([vector for vector, _ in self.springs])
        matrices = np.einsum("ik,iak,ibk->kab", np.array(stiffness), vectors, vectors)
        self._strains.set_matrices(self._matrix, matrices)

    # Whether anything is admissible.

    def holding(self, stiffness: float, largest: float) -> FloatArray:
        """Springs in proportion to the least eigenvalue of y, so that small forces leave it."""
        least = np.maximum(self.z[0] - norm(self.z[1:]), 0.0)
        return np.asarray(least * (stiffness / largest if largest > 0.0 else 0.0))

    def resistance(self, reactions: FloatArray) -> float:
        """``int M tr y`` for y without negative eigenvalues."""
        turned = TURN @ reactions
        if np.any(turned[0] < norm(turned[1:])):
            return np.inf
        return float(self.weights @ (self.limit * math.sqrt(2.0) * turned[0]))
