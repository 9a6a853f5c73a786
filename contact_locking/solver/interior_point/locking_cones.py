"""Limits of the strain as families of cones: balls of norms, and half lines of half spaces."""

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
from contact_locking.solver.interior_point.cones import Balls, HalfLines
from contact_locking.solver.interior_point.family import Family
from contact_locking.solver.interior_point.lorentz import aligned, norm
from contact_locking.solver.interior_point.strain_operator import StrainOperator
from contact_locking.solver.multipliers import Multipliers


class LimitsOfStrain(Family):
    """Cones at the points of ``strains``, the family number ``number`` of the sets of strains.

    ``limit`` (k,) is M, and ``compliance = 1/(2n)`` is 0 for n = inf.
    """

    limit: FloatArray

    #: Whether the start compares the elastic strain with M: a half space limits one component only.
    bounds_norm = True

    def __init__(self, strains: StrainOperator, compliance: float, number: int) -> None:
        self.strains, self._number, self.compliance = strains, number, compliance
        self.comm, self.weights, self.limit = strains.comm, strains.weights, strains.limit

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

    def is_stiff(self, factor: float, material: float) -> BoolArray:
        """Where D is stiffer than the material, and than its softest point; collective."""
        stiffness = self.stiffest
        return np.asarray(stiffness > factor * max(material, minimum(self.comm, stiffness)))

    def stiff_nodes(self, factor: float, material: float) -> IndexArray:
        return self.strains.nodes_at(self.is_stiff(factor, material))

    def soften(self, factor: float, material: float) -> None:
        is_stiff = self.is_stiff(factor, material)
        self.write_springs([np.where(is_stiff, 0.0, values) for _, values in self.springs])

    def along(self, points: IndexArray, directions: FloatArray) -> PETSc.Mat:
        return self.strains.along(points, directions)

    def describe_excess(self) -> str:
        """Where what was seen exceeds its limit the most, "" below; collective."""
        what = "the strain" if self._number == 0 else f"the strain of {self.strains.law.name}"
        return self.strains.describe_excess(np.maximum(self.reach, 0.0) / self.limit, what)


class LockingCones(LimitsOfStrain, Balls):
    """``|L eps| <= M``, with the linear map L of the ``law`` of ``strains``.

    ``L eps`` and the multipliers y are Mandel vectors (m, k).
    """

    def __init__(self, strains: StrainOperator, compliance: float, number: int) -> None:
        super().__init__(strains, compliance, number)
        self.x, self.z = np.zeros((2, 1 + strains.rows, len(self.limit)))

    @property
    def reach(self) -> FloatArray:
        return norm(self.seen)

    @property
    def penalised(self) -> FloatArray:
        length = norm(self.seen)
        # The limit is above zero, and a strain need not be.
        beyond = np.maximum(length - self.limit, 0.0) / np.maximum(length, self.limit)
        return beyond / self.compliance * self.seen

    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        self.strains.set_tensors(multipliers.parts[self._number], self.reactions)

    def read(self, multipliers: Multipliers) -> FloatArray:
        y = self.strains.mandel(multipliers.parts[self._number])
        return np.vstack([norm(y), -y])

    def centred(self, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        return aligned(x, z, np.ones(len(self.weights), dtype=bool))

    def tangent_term(self, v: Expr, du: Expr) -> Expr:
        """``int a L eps(du) : L eps(v) + b (W : L eps(du)) (W : L eps(v))``."""
        places, law = self.strains, self.strains.law
        self._a, self._b = fem.Function(places.scalars), fem.Function(places.scalars)
        self._w = fem.Function(places.tensors)
        eps, eps_v = (law.measured(places.strain(w)) for w in (du, v))
        isotropic = self._a * ufl.inner(eps, eps_v) * places.dx
        along = self._b * ufl.inner(self._w, eps) * ufl.inner(self._w, eps_v)
        return isotropic + along * places.dx

    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        self.strains.set_values(self._a, self.a)
        self.strains.set_values(self._b, stiffness[0])
        self.strains.set_tensors(self._w, self.w)

    def soften(self, factor: float, material: float) -> None:
        super().soften(factor, material)
        self.strains.set_values(self._a, np.where(self.is_stiff(factor, material), 0.0, self.a))


class StrainHalfLines(LimitsOfStrain, HalfLines):
    """``N : eps <= M`` with the multiplier ``y >= 0``."""

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

    def start(self, level: float, least: float) -> None:
        # The same distance from the limit as that of a norm.
        self.x = np.maximum(self.limit, 1.5 * np.abs(self.seen)) - self.seen
        self.z = np.asarray(level / self.x)

    def sizes(self, deformation: float) -> FloatArray:
        return self.limit + np.abs(self.seen)

    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        self.strains.set_values(multipliers.parts[self._number], self.reactions)

    def read(self, multipliers: Multipliers) -> FloatArray:
        return multipliers.parts[self._number].x.array[self.strains.dofs]

    def tangent_term(self, v: Expr, du: Expr) -> Expr:
        """``int k (N : eps(du)) (N : eps(v))``."""
        places, law = self.strains, self.strains.law
        self._k = fem.Function(places.scalars)
        eps, eps_v = (law.measured(places.strain(w)) for w in (du, v))
        return self._k * eps * eps_v * places.dx

    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        self.strains.set_values(self._k, stiffness[0])
