"""How PETSc stores a matrix: in blocks of a node's components, or entry by entry.

In blocks, products and assembly take half the time.  Factorisations and the Galerkin products of
multigrid know nothing of blocks.
"""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

IN_BLOCKS, BY_ENTRY = "baij", "aij"


class Unblocked:
    """A matrix stored in blocks as every preconditioner can do with it."""

    def __init__(self) -> None:
        self._copy: PETSc.Mat | None = None

    def of(self, matrix: PETSc.Mat) -> PETSc.Mat:
        """The same matrix for all matrices of one pattern, with the values of this; collective.

        A matrix of one rank that is stored by entry is returned itself.
        """
        if matrix.getType() == PETSc.Mat.Type.SEQAIJ:
            matrix.setOption(PETSc.Mat.Option.SPD, True)
            return matrix
        if self._copy is None:
            self._copy = matrix.convert(BY_ENTRY, PETSc.Mat())
            self._copy.setNearNullSpace(matrix.getNearNullSpace())
        else:
            matrix.convert(BY_ENTRY, self._copy)
        # PETSc forgets it with each new value.
        self._copy.setOption(PETSc.Mat.Option.SPD, True)
        return self._copy

    def destroy(self) -> None:
        """Free the matrix; collective."""
        if self._copy is not None:
            self._copy.destroy()


def stacked(matrices: Sequence[PETSc.Mat]) -> PETSc.Mat:
    """The rows of the matrices, one matrix after another on each rank, which it destroys."""
    nest = PETSc.Mat().createNest([[matrix] for matrix in matrices], comm=matrices[0].getComm())
    rows = nest.convert(BY_ENTRY, PETSc.Mat())
    for item in (nest, *matrices):
        item.destroy()
    return rows
