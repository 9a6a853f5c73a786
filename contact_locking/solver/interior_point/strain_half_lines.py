"""The cones of a one-sided limit of the strain: along a direction, or of the volume."""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from petsc4py import PETSc
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.parallel import minimum
from contact_locking.problem.rounding import ROUNDING
from contact_locking.solver.interior_point.half_lines import HalfLines
from contact_locking.solver.interior_point.measures import relative_rms
from contact_locking.solver.interior_point.strain_operator import StrainOperator
from contact_locking.solver.multipliers import Multipliers


class StrainHalfLines(HalfLines):
    """``x = M + q - N : eps >= 0`` with cost ``n q^2``, and its multiplier ``z = y >= 0``.

    ``q = z/(2n)``, so that the compliance is ``1/(2n)``, 0 for n = inf.  ``limit`` is M (k,) at the
    points of ``strains``, the family number ``number`` of the sets of strains.
    """

    stops_rigid_motions = False
    scale = 1.0

    def __init__(self, strains: StrainOperator, compliance: float, number: int) -> None:
        self._strains, self._number, self.compliance = strains, number, compliance
        self.comm, self.weights = strains.comm, strains.weights
        self.x, self.z = np.zeros((2, len(strains.limit)))

    @property
    def limit(self) -> FloatArray:
        return self._strains.limit

    # The displacement and the forces.

    def see(self, displacement: FloatArray) -> FloatArray:
        return self._strains.strains(displacement)[0]

    def add_forces(self, reactions: FloatArray, forces: PETSc.Vec) -> None:
        self._strains.add_forces(reactions, forces)

    # The iterate.

    def start(self, level: float, least: float) -> None:
        # The same distance from the limit as that of a norm.
        self.x = np.maximum(self.limit, 1.5 * np.abs(self.seen)) - self.seen
        self.z = np.asarray(level / self.x)

    def primal_residual(self, deformation: float) -> float:
        size = self.limit + np.abs(self.seen)
        return relative_rms(self.comm, self.weights, self.primal_gap(), size)

    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        self._strains.set_scalars(multipliers.parts[self._number], self.reactions)

    # The tangent.

    def tangent_term(self, v: Expr, du: Expr) -> Expr:
        """``int k (N : eps(du)) (N : eps(v))``."""
        places, law = self._strains, self._strains.law
        self._k = fem.Function(places.scalars)
        eps, eps_v = (law.measured(places.strain(w)) for w in (du, v))
        return self._k * eps * eps_v * places.dx

    def write_block(self) -> None:
        self._strains.set_scalars(self._k, self.stiffness)

    def soften(self, factor: float, material: float) -> None:
        is_stiff = self._relative_stiffness(material) > factor
        self._strains.set_scalars(self._k, np.where(is_stiff, 0.0, self.stiffness))

    def stiff_nodes(self, factor: float, material: float) -> IndexArray:
        return self._strains.nodes_at(self._relative_stiffness(material) > factor)

    def stiff_rows(self, factor: float, material: float) -> tuple[PETSc.Mat, FloatArray]:
        is_stiff = self.stiffness > factor * material
        rows = self._strains.along(is_stiff, np.ones((1, np.count_nonzero(is_stiff))))
        return rows, self.stiffness[is_stiff] / self.weights[is_stiff]

    def soften_along(self, factor: float, material: float) -> None:
        is_stiff = self.stiffness > factor * material
        self._strains.set_scalars(self._k, np.where(is_stiff, 0.0, self.stiffness))

    def _relative_stiffness(self, material: float) -> FloatArray:
        """How much stiffer points are than the material, and than the softest; collective."""
        return np.asarray(self.stiffness / max(material, minimum(self.comm, self.stiffness)))

    # The start, and whether anything is admissible.

    def is_kept(self, margin: float, displacement: float) -> bool:
        return bool(np.all(self.seen <= self.limit * (1.0 + margin + ROUNDING)))

    def body_work(self) -> float:
        return self.power(self.reactions, self.seen)

    def describe_excess(self) -> str:
        ratio = np.maximum(self.seen, 0.0) / self.limit
        return self._strains.describe_excess(ratio, f"the strain of {self._strains.law.name}")
