"""Strains of a displacement and forces of stresses, as one sparse matrix and its transpose."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx.fem import petsc
from petsc4py import PETSc

from contact_locking.arrays import BoolArray, FloatArray, IndexArray
from contact_locking.laws.elasticity import MANDEL_PAIRS, mandel_factor, mandel_vector, strain
from contact_locking.problem import compiled
from contact_locking.problem.forms import ProblemData


class StrainOperator:
    """``v -> eps(v)`` at points with weights, and ``Z -> int Z : eps(.)`` for Z at these points.

    Strains and stresses are Mandel vectors (m, k), m being ``rows``, at k points of cells of this
    rank.  The points are the degrees of freedom ``dofs`` (k,) of the spaces of strains ``scalars``
    and ``tensors``, and lie in the cells ``cells`` (k,).  ``weights`` (k,) are the weights of the
    locking rule at the points, and ``dx`` is the measure with this rule.
    """

    def __init__(
        self,
        space: fem.FunctionSpace,
        data: ProblemData,
        dofs: IndexArray,
        cells: IndexArray,
    ) -> None:
        mesh, element, dx = space.mesh, data.element, data.locking_dx
        self.space, self.dx, self.dofs, self.cells = space, dx, dofs, cells
        self.comm, self.dim = mesh.comm, mesh.topology.dim
        self.rows = len(MANDEL_PAIRS[self.dim])
        self._owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        vectors = element.strain_space(mesh, (self.rows,))
        form = compiled.form(
            ufl.inner(mandel_vector(strain(ufl.TrialFunction(space))), ufl.TestFunction(vectors))
            * dx
        )
        by_cell = petsc.create_matrix(form)
        # Half of the entries, at least, are zero: a normal strain knows one component only.
        by_cell.setOption(PETSc.Mat.Option.IGNORE_ZERO_ENTRIES, True)
        petsc.assemble_matrix(by_cell, form)
        by_cell.assemble()
        self._matrix = self._by_component(by_cell)
        by_cell.destroy()
        self.scalars = element.strain_space(mesh)
        self.tensors = element.strain_space(mesh, (self.dim, self.dim))
        self.weights: FloatArray = fem.assemble_vector(
            compiled.form(ufl.TestFunction(self.scalars) * dx)
        ).array[dofs]
        self._displacement, self._integrals = self._matrix.createVecs()

    def strains(self, displacement: FloatArray) -> FloatArray:
        """The strains (m, k) of a displacement (owned values, others are ignored); collective."""
        self._displacement.array_w[:] = displacement[: self._owned]
        self._matrix.mult(self._displacement, self._integrals)
        return self._integrals.array_r.reshape(self.rows, -1) / self.weights

    def add_forces(self, stress: FloatArray, forces: PETSc.Vec) -> None:
        """``forces += int Z : eps(.)``; collective."""
        self._integrals.array_w[:] = stress.reshape(-1)
        self._matrix.multTransposeAdd(self._integrals, forces, forces)

    def set_tensors(self, function: fem.Function, mandel: FloatArray) -> None:
        """Give a function of ``tensors`` Mandel vectors (m, k) as values; collective."""
        tensors = function.x.array.reshape(-1, self.dim, self.dim)
        for row, (i, j) in zip(mandel, MANDEL_PAIRS[self.dim], strict=True):
            tensors[self.dofs, i, j] = tensors[self.dofs, j, i] = row / mandel_factor(i, j)
        function.x.scatter_forward()

    def nodes_at(self, points: BoolArray) -> IndexArray:
        """The owned nodes of the cells of marked points (k,), of all ranks; collective."""
        touched = fem.Function(self.space)
        blocks = self.space.dofmap.list[self.cells[points]]
        touched.x.array.reshape(-1, self.dim)[blocks.reshape(-1)] = 1.0
        touched.x.scatter_reverse(la.InsertMode.add)
        is_touched = touched.x.array[: self._owned].reshape(-1, self.dim)[:, 0] > 0.0
        return np.flatnonzero(is_touched).astype(np.int32)

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        for item in (self._matrix, self._displacement, self._integrals):
            item.destroy()

    def _by_component(self, by_cell: PETSc.Mat) -> PETSc.Mat:
        """The rows of the chosen points, those of one component after those of another."""
        starts, columns, values = by_cell.getValuesCSR()
        rows = (np.arange(self.rows)[:, None] + self.rows * self.dofs).reshape(-1)
        counts = np.diff(starts)[rows]
        ends = np.cumsum(counts)
        taken = np.arange(counts.sum()) + np.repeat(starts[rows] - ends + counts, counts)
        return PETSc.Mat().createAIJ(
            ((len(rows), None), by_cell.getSizes()[1]),
            csr=(np.append(0, ends).astype(PETSc.IntType), columns[taken], values[taken]),
            comm=by_cell.getComm(),
        )
