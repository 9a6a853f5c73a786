"""The cones of limits of the strain: Lorentz cones of norms, and half lines of half spaces."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc
from ufl.core.expr import Expr

from contact_locking.arrays import BoolArray, FloatArray, IndexArray
from contact_locking.parallel import minimum
from contact_locking.problem.rounding import ROUNDING
from contact_locking.solver.interior_point.family import Family, Springs, Step, dot
from contact_locking.solver.interior_point.half_lines import HalfLines
from contact_locking.solver.interior_point.lorentz import (
    LorentzCones,
    Scaling,
    aligned,
    inverse,
    norm,
)
from contact_locking.solver.interior_point.strain_operator import StrainOperator
from contact_locking.solver.multipliers import Multipliers

# Newton's method for one cone halves the distance to a double root, and else is fast.
_MOST_STEPS = 40


class LimitsOfStrain(Family):
    """Cones at the points of ``strains``, the family number ``number`` of the sets of strains.

    ``compliance = 1/(2n)`` is 0 for n = inf.
    """

    scale = 1.0
    #: Whether the start compares the elastic strain with M: a half space limits one component only.
    bounds_norm = True

    def __init__(self, strains: StrainOperator, compliance: float, number: int) -> None:
        self.strains, self._number, self.compliance = strains, number, compliance
        self.comm, self.weights = strains.comm, strains.weights

    @property
    def limit(self) -> FloatArray:
        """M (k,)."""
        return self.strains.limit

    @property
    @abstractmethod
    def reach(self) -> FloatArray:
        """The measure (k,) of the seen strain that M bounds."""

    @property
    @abstractmethod
    def penalised(self) -> FloatArray:
        """The reactions that the penalty law (23) gives for the seen strain, for n < inf."""

    @abstractmethod
    def tangent_term(self, v: Expr, du: Expr) -> Expr:
        """``int D lin(du) . lin(v)`` in UFL, with coefficients that belong to this family."""

    def see(self, displacement: FloatArray) -> FloatArray:
        return self.strains.strains(displacement)

    def add_forces(self, reactions: FloatArray, forces: PETSc.Vec) -> None:
        self.strains.add_forces(reactions, forces)

    def is_kept(self, margin: float, displacement: float) -> bool:
        return bool(np.all(self.reach <= self.limit * (1.0 + margin + ROUNDING)))

    @property
    @abstractmethod
    def stiffest(self) -> FloatArray:
        """The largest eigenvalue (k,) of the block D."""

    def is_stiff(self, factor: float, material: float) -> BoolArray:
        """Where D is stiffer than the material, and than its softest point; collective."""
        stiffness = self.stiffest
        return np.asarray(stiffness > factor * max(material, minimum(self.comm, stiffness)))

    def stiff_nodes(self, factor: float, material: float) -> IndexArray:
        return self.strains.nodes_at(self.is_stiff(factor, material))

    def write_block(self) -> None:
        self.write_springs([values for _, values in self.springs])

    def soften(self, factor: float, material: float) -> None:
        is_stiff = self.is_stiff(factor, material)
        self.write_springs([np.where(is_stiff, 0.0, values) for _, values in self.springs])

    def along(self, points: IndexArray, directions: FloatArray) -> PETSc.Mat:
        return self.strains.along(points, directions)

    def describe_excess(self) -> str:
        """Where what was seen exceeds its limit the most, "" below; collective."""
        what = "the strain" if self._number == 0 else f"the strain of {self.strains.law.name}"
        return self.strains.describe_excess(np.maximum(self.reach, 0.0) / self.limit, what)


class LockingCones(LimitsOfStrain, LorentzCones):
    """``x = (M + q, L eps)`` in the cone with cost ``n q^2`` at every point; ``z = (z_0, -y)``.

    ``L`` is the linear map of the ``law`` of ``strains``, ``limit`` is M (k,).
    ``q = z_0/(2n)`` holds throughout; ``compliance = 1/(2n)`` is 0 for n = inf.  ``L eps`` and the
    multipliers y are Mandel vectors (m, k).
    """

    def __init__(self, strains: StrainOperator, compliance: float, number: int) -> None:
        super().__init__(strains, compliance, number)
        self.x, self.z = np.zeros((2, 1 + strains.rows, len(self.limit)))

    def reactions_of(self, z: FloatArray) -> FloatArray:
        return -z[1:]

    @property
    def reach(self) -> FloatArray:
        return norm(self.seen)

    @property
    def penalised(self) -> FloatArray:
        length = norm(self.seen)
        # The limit is above zero, and a strain need not be.
        beyond = np.maximum(length - self.limit, 0.0) / np.maximum(length, self.limit)
        return beyond / self.compliance * self.seen

    # The iterate.

    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        self.strains.set_tensors(multipliers.parts[self._number], self.reactions)

    def start(self, level: float, least: float) -> None:
        radius = np.maximum(self.limit, 1.5 * norm(self.seen))
        self.x = np.vstack([radius, self.seen])
        self.z = level * inverse(self.x)

    def primal_residual(self, deformation: float) -> float:
        return self.relative_gap(self.x)

    def primal_gap(self) -> FloatArray:
        """``(M + q, L eps) - x``."""
        return np.vstack([self.limit + self.compliance * self.z[0], self.seen]) - self.x

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

    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        self._aim = self._scaling.aim(target, correction)
        return -(self.z + self._dual_step(self._gap[1:]))[1:]

    def step(self, seen: FloatArray) -> Step:
        d_rest = self._gap[1:] + seen
        dz = self._dual_step(d_rest)
        return Step(np.vstack([self._gap[0] + self._yielding * dz[0], d_rest]), dz)

    def centred(self, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        return aligned(x, z, np.ones(len(self.weights), dtype=bool))

    def move_adjoint(self, seen: FloatArray, reactions: FloatArray) -> FloatArray:
        along = dot(self.w, reactions) / (self.a + self.b * dot(self.w, self.w))
        return np.vstack([-2.0 * self.a * self._share * self._scaling.w[0] * along, reactions])

    def settle(self, product: float) -> None:
        strain, limit = norm(self.seen), self.limit
        share = self.compliance * product
        x_0 = np.maximum(strain, limit) + np.sqrt(share)
        # Newton's method from above on (x_0 - M)(x_0^2 - |L eps|^2) = compliance product x_0.
        for _ in range(_MOST_STEPS):
            det = (x_0 - strain) * (x_0 + strain)
            value = (x_0 - limit) * det - share * x_0
            x_0 -= value / (det + 2.0 * (x_0 - limit) * x_0 - share)
        self.x = np.vstack([x_0, self.seen])
        # Beyond the limit ``z_0 = q/compliance`` has more digits than ``x^-1``.
        z_0 = np.where(
            strain > limit, (x_0 - limit) / self.compliance, product * inverse(self.x)[0]
        )
        self.z = -z_0 / x_0 * self.x
        self.z[0] = z_0

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

    # The tangent.

    def tangent_term(self, v: Expr, du: Expr) -> Expr:
        """``int a L eps(du) : L eps(v) + b (W : L eps(du)) (W : L eps(v))``."""
        places, law = self.strains, self.strains.law
        self._a, self._b = fem.Function(places.scalars), fem.Function(places.scalars)
        self._w = fem.Function(places.tensors)
        eps, eps_v = (law.measured(places.strain(w)) for w in (du, v))
        isotropic = self._a * ufl.inner(eps, eps_v) * places.dx
        along = self._b * ufl.inner(self._w, eps) * ufl.inner(self._w, eps_v)
        return isotropic + along * places.dx

    @property
    def springs(self) -> Springs:
        """Along w; the rest of the block is isotropic."""
        return [(self.w, self.b)]

    @property
    def stiffest(self) -> FloatArray:
        return np.asarray(self.a + np.maximum(self.b, 0.0) * dot(self.w, self.w))

    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        self.strains.set_values(self._a, self.a)
        self.strains.set_values(self._b, stiffness[0])
        self.strains.set_tensors(self._w, self.w)

    def soften(self, factor: float, material: float) -> None:
        super().soften(factor, material)
        self.strains.set_values(self._a, np.where(self.is_stiff(factor, material), 0.0, self.a))

    # Whether anything is admissible.

    def largest_multiplier(self) -> float:
        return float(self.z[0].max(initial=0.0))

    def resistance(self, reactions: FloatArray) -> float:
        """``int M |y|``."""
        return float(self.weights @ (self.limit * np.linalg.norm(reactions, axis=0)))


class StrainHalfLines(LimitsOfStrain, HalfLines):
    """``x = M + q - N : eps >= 0`` with cost ``n q^2``, and its multiplier ``z = y >= 0``.

    ``q = z/(2n)``, so that the compliance is ``1/(2n)``, 0 for n = inf.
    """

    bounds_norm = False

    def __init__(self, strains: StrainOperator, compliance: float, number: int) -> None:
        super().__init__(strains, compliance, number)
        self.x, self.z = np.zeros((2, len(strains.limit)))

    def see(self, displacement: FloatArray) -> FloatArray:
        return super().see(displacement)[0]

    @property
    def reach(self) -> FloatArray:
        return self.seen

    @property
    def penalised(self) -> FloatArray:
        return np.maximum(self.seen - self.limit, 0.0) / self.compliance

    # The iterate.

    def start(self, level: float, least: float) -> None:
        # The same distance from the limit as that of a norm.
        self.x = np.maximum(self.limit, 1.5 * np.abs(self.seen)) - self.seen
        self.z = np.asarray(level / self.x)

    def primal_residual(self, deformation: float) -> float:
        return self.relative_gap(self.limit + np.abs(self.seen))

    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        self.strains.set_values(multipliers.parts[self._number], self.reactions)

    # The tangent.

    def tangent_term(self, v: Expr, du: Expr) -> Expr:
        """``int k (N : eps(du)) (N : eps(v))``."""
        places, law = self.strains, self.strains.law
        self._k = fem.Function(places.scalars)
        eps, eps_v = (law.measured(places.strain(w)) for w in (du, v))
        return self._k * eps * eps_v * places.dx

    @property
    def springs(self) -> Springs:
        return [(np.ones((1, len(self.stiffness))), self.stiffness)]

    @property
    def stiffest(self) -> FloatArray:
        return self.stiffness

    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        self.strains.set_values(self._k, stiffness[0])
