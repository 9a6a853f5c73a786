"""How PETSc stores a matrix: in blocks of a node's components, or entry by entry.

In blocks, products and assembly take half the time.  Factorisations and the Galerkin products of
multigrid know nothing of blocks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
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


def stacked(matrices: Sequence[PETSc.Mat], like: PETSc.Mat) -> PETSc.Mat:
    """The rows of the matrices, one matrix after another on each rank; collective.

    The matrices have the columns of ``like`` and are destroyed.
    """
    lengths, columns, values = [], [], []
    for matrix in matrices:
        ends, where, what = matrix.getValuesCSR()
        lengths.append(np.diff(ends))
        columns.append(where)
        values.append(what)
        matrix.destroy()
    each = np.concatenate(lengths)
    ends = np.append(0, np.cumsum(each)).astype(PETSc.IntType)
    return PETSc.Mat().createAIJ(
        ((len(each), None), like.getSizes()[1]),
        csr=(ends, np.concatenate(columns), np.concatenate(values)),
        comm=like.getComm(),
    )
