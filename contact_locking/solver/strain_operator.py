"""Strains of a displacement and forces of stresses, as one sparse matrix and its transpose."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from petsc4py import PETSc

from contact_locking import compiled
from contact_locking.material import MANDEL_PAIRS, mandel_vector, strain

FloatArray = npt.NDArray[np.float64]


class StrainOperator:
    """``v -> int_K eps(v)``, cell by cell, and ``Z -> int Z : eps(.)`` for Z constant per cell.

    Strains and stresses are Mandel vectors (m, k) of the chosen k cells, which are owned degrees of
    freedom of P0 spaces; ``volumes`` (k,) are theirs.
    """

    def __init__(
        self, space: fem.FunctionSpace, dx: ufl.Measure, cells: npt.NDArray[np.int32]
    ) -> None:
        mesh = space.mesh
        self._rows = len(MANDEL_PAIRS[mesh.topology.dim])
        tensors = fem.functionspace(mesh, ("DG", 0, (self._rows,)))
        form = compiled.form(
            ufl.inner(mandel_vector(strain(ufl.TrialFunction(space))), ufl.TestFunction(tensors))
            * dx
        )
        by_cell = petsc.create_matrix(form)
        # Half of the entries, at least, are zero: a normal strain knows one component only.
        by_cell.setOption(PETSc.Mat.Option.IGNORE_ZERO_ENTRIES, True)
        petsc.assemble_matrix(by_cell, form)
        by_cell.assemble()
        self._matrix = self._by_component(by_cell, cells)
        by_cell.destroy()
        scalars = fem.functionspace(mesh, ("DG", 0))
        self.volumes: FloatArray = fem.assemble_vector(
            compiled.form(ufl.TestFunction(scalars) * dx)
        ).array[cells]
        self._integrals = self._matrix.createVecLeft()

    def strains(self, displacement: PETSc.Vec) -> FloatArray:
        """The strains (m, k); collective."""
        self._matrix.mult(displacement, self._integrals)
        return self._integrals.array_r.reshape(self._rows, -1) / self.volumes

    def add_forces(self, stress: FloatArray, forces: PETSc.Vec) -> None:
        """``forces += int Z : eps(.)``; collective."""
        self._integrals.array_w[:] = stress.reshape(-1)
        self._matrix.multTransposeAdd(self._integrals, forces, forces)

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        self._matrix.destroy()
        self._integrals.destroy()

    def _by_component(self, by_cell: PETSc.Mat, cells: npt.NDArray[np.int32]) -> PETSc.Mat:
        """The rows of the chosen cells, those of one component after those of another."""
        starts, columns, values = by_cell.getValuesCSR()
        rows = (np.arange(self._rows)[:, None] + self._rows * cells).reshape(-1)
        counts = np.diff(starts)[rows]
        ends = np.cumsum(counts)
        taken = np.arange(counts.sum()) + np.repeat(starts[rows] - ends + counts, counts)
        return PETSc.Mat().createAIJ(
            ((len(rows), None), by_cell.getSizes()[1]),
            csr=(np.append(0, ends).astype(PETSc.IntType), columns[taken], values[taken]),
            comm=by_cell.getComm(),
        )
