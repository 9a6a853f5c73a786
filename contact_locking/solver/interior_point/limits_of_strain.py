"""The common parts of families of limits of the strain."""

from __future__ import annotations

import functools
from abc import abstractmethod

import numpy as np
from petsc4py import PETSc

from contact_locking.arrays import BoolArray, FloatArray, IndexArray
from contact_locking.parallel import minimum
from contact_locking.problem.rounding import ROUNDING
from contact_locking.solver.interior_point.family import Family, dot
from contact_locking.solver.interior_point.lorentz import LorentzCones, aligned
from contact_locking.solver.interior_point.strain_operator import StrainOperator
from contact_locking.solver.multipliers import Multipliers


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

    def by_limit(self, gaps: FloatArray) -> FloatArray:
        """The gain (k,) by M of whatever gains by ``gaps`` of the points, as `primal_gap` has M."""
        return np.asarray(np.atleast_2d(gaps)[0])

    @property
    @abstractmethod
    def reach(self) -> FloatArray:
        """The measure (k,) of the seen strain that M bounds."""

    @property
    @abstractmethod
    def penalised(self) -> FloatArray:
        """The reactions that the penalty law (23) gives for the seen strain, for n < inf."""

    def see(self, displacement: FloatArray) -> FloatArray:
        return self.strains.strains(displacement)

    def add_forces(self, reactions: FloatArray, forces: PETSc.Vec) -> None:
        self.strains.add_forces(reactions, forces)

    def is_kept(self, margin: float, displacement: float) -> bool:
        return bool(np.all(self.reach <= self.limit * (1.0 + margin + ROUNDING)))

    @property
    def stiffest(self) -> FloatArray:
        """The largest eigenvalue (k,) of the block D."""
        sizes = [values * dot(direction, direction) for direction, values in self.springs]
        return functools.reduce(np.maximum, sizes)

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


class StrainCones(LimitsOfStrain, LorentzCones):
    """Lorentz cones of limits of the strain, whose multipliers are Mandel vectors."""

    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        self.strains.set_tensors(multipliers.parts[self._number], self.reactions)

    def centred(self, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        return aligned(x, z, np.ones(len(self.weights), dtype=bool))

    def largest_multiplier(self) -> float:
        return float(self.z[0].max(initial=0.0))
