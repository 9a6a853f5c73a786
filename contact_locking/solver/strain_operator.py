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
        self._cells = cells
        tensors = fem.functionspace(mesh, ("DG", 0, (self._rows,)))
        form = compiled.form(
            ufl.inner(mandel_vector(strain(ufl.TrialFunction(space))), ufl.TestFunction(tensors))
            * dx
        )
        self._matrix = petsc.create_matrix(form)
        # Half of the entries, at least, are zero: a normal strain knows one component only.
        self._matrix.setOption(PETSc.Mat.Option.IGNORE_ZERO_ENTRIES, True)
        petsc.assemble_matrix(self._matrix, form)
        self._matrix.assemble()
        scalars = fem.functionspace(mesh, ("DG", 0))
        self.volumes: FloatArray = fem.assemble_vector(
            compiled.form(ufl.TestFunction(scalars) * dx)
        ).array[cells]
        self._integrals = self._matrix.createVecLeft()

    def strains(self, displacement: PETSc.Vec) -> FloatArray:
        """The strains (m, k); collective."""
        self._matrix.mult(displacement, self._integrals)
        integrals = self._integrals.array_r.reshape(-1, self._rows)[self._cells]
        return np.ascontiguousarray(integrals.T) / self.volumes

    def add_forces(self, stress: FloatArray, forces: PETSc.Vec) -> None:
        """``forces += int Z : eps(.)``; collective."""
        integrals = self._integrals.array_w.reshape(-1, self._rows)
        integrals[:] = 0.0
        integrals[self._cells] = stress.T
        self._matrix.multTransposeAdd(self._integrals, forces, forces)

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        self._matrix.destroy()
        self._integrals.destroy()
