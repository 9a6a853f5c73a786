"""What of the tangent the preconditioners of an iterative solver take out: the stiff points."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.solver.interior_point.family import Family
from contact_locking.solver.interior_point.tuning import Tuning
from contact_locking.solver.linear.filtered_multigrid import StiffPart
from contact_locking.solver.linear.storage import stacked
from contact_locking.supports.conditions import Constraints


@dataclass(frozen=True)
class StiffFamilies:
    """The points of families that are stiffer than a material by the factors of the tuning.

    ``material`` is the stiffness of the material, ``constraints`` are those of the body, and
    ``degree`` is that of its elements.
    """

    families: Sequence[Family]
    tuning: Tuning
    material: float
    constraints: Constraints
    degree: int

    def of(self, matrix: PETSc.Mat, assemble: Callable[[PETSc.Mat], None]) -> StiffPart:
        """What of ``matrix`` is stiff; ``assemble`` assembles the blocks as written; collective."""
        stiff, nearly = self.tuning.stiff, self.tuning.nearly_stiff
        is_linear = self.degree == 1
        along = self.tuning.stiff_along if is_linear else self.tuning.stiff_along_quadratic

        def assemble_rest(rest: PETSc.Mat) -> None:
            for family in self.families:
                family.soften(stiff, self.material)
            assemble(rest)

        def assemble_across(rest: PETSc.Mat) -> None:
            for family in self.families:
                family.soften_along(along, self.material)
            assemble(rest)

        return StiffPart(
            self._nodes(stiff),
            lambda: self._nodes(nearly),
            assemble_rest,
            lambda: self._rows(along, matrix),
            assemble_across,
        )

    def _rows(self, factor: float, matrix: PETSc.Mat) -> tuple[PETSc.Mat, FloatArray]:
        """The rows of all families, without the part that is prescribed; collective."""
        found = [family.stiff_rows(factor, self.material) for family in self.families]
        rows = stacked([part for part, _ in found], matrix)
        free = matrix.createVecRight()
        free.array_w[:] = self.constraints.free_dofs()[: free.getLocalSize()]
        rows.diagonalScale(None, free)
        free.destroy()
        rows = self.constraints.supports.directions.projected_columns(rows)
        return rows, np.concatenate([stiffness for _, stiffness in found])

    def _nodes(self, factor: float) -> IndexArray:
        """The owned nodes with something free that are stiffer than the material; collective."""
        found = (family.stiff_nodes(factor, self.material) for family in self.families)
        nodes = functools.reduce(np.union1d, found)
        is_free = self.constraints.free_nodes()
        return nodes[is_free[nodes]].astype(np.int32)
