"""Projection onto the displacements that no stiff point of the body or of contact resists.

With ``A = A_0 + C^T B C``, where each row of ``C`` takes the strain of a point of a cell, or the
displacement of a point of contact, along a direction in which the point is stiff, and ``B`` holds
these stiffnesses, the projection is

    Q = I - K^T T^-1 C,    K = C D^-1,    T = C K^T + B^-1,

with ``D`` the diagonal blocks of ``A_0``.  For a preconditioner ``G`` of the soft matrix ``A_0``,

    Q G Q^T + K^T T^-1 B^-1 T^-1 K

preconditions ``A`` for any stiffness: B stands in it as ``B^-1`` only, and ``Q`` depends on it
less, the larger it is.  T has one row for each stiff point, a scalar each, so that factorising T
costs a small part of what factorising the stiff part of A does.  How well ``Q`` keeps the
energy of smooth displacements decides about the number of iterations; compare the least-squares
commutators of doi:10.1137/040608817, which contain the same matrix ``C D^-1 C^T``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc

from contact_locking.arrays import FloatArray
from contact_locking.solver.linear.ksp import create_ksp, destroy_ksp, direct_options
from contact_locking.solver.linear.multigrid import Multigrid
from contact_locking.solver.linear.options import PREFIX


class Projection:
    """``Q`` for one matrix; all of it is collective.

    ``rows`` is C, (k, n), whose columns of constrained unknowns are zero, and ``stiffness`` (k,)
    the diagonal of B, > 0, on this rank.  ``soft`` is ``A_0``, stored by entry, with blocks of the
    components of a node.  The projection owns ``rows``.
    """

    def __init__(self, rows: PETSc.Mat, stiffness: FloatArray, soft: PETSc.Mat) -> None:
        # C, the diagonal of B^-1, and K.
        self._rows, self._compliance = rows, 1.0 / stiffness
        inverse = _inverse_blocks(soft)
        self._scaled = rows.matMult(inverse)
        inverse.destroy()
        columns = PETSc.Mat()
        rows.transpose(columns)
        self._coupling = self._scaled.matMult(columns)
        columns.destroy()
        diagonal = self._coupling.getDiagonal()
        diagonal.array_w[:] += self._compliance
        self._coupling.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        self._coupling.setDiagonal(diagonal)
        self._coupling.setOption(PETSc.Mat.Option.SPD, True)
        diagonal.destroy()
        self._change, self._right = rows.createVecs()
        self._forces, self._forces_change = self._right.duplicate(), self._right.duplicate()
        # None where nothing is stiff.
        self._factor: PETSc.KSP | None = None
        if rows.getSize()[0] > 0:
            comm = rows.getComm()
            self._factor = create_ksp(comm, direct_options(comm), prefix=PREFIX + "projection_")
            self._factor.setOperators(self._coupling)
            self._factor.setUp()

    def apply(self, soft: Multigrid, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """``z = B r`` with ``soft`` in the place of G."""
        if self._factor is None:
            soft.apply(r, z)
            return
        change, right, forces = self._change, self._right, self._forces
        self._scaled.mult(r, right)
        self._factor.solve(right, forces)
        # z = G Q^T r
        self._rows.multTranspose(forces, change)
        change.aypx(-1.0, r)
        soft.apply(change, z)
        # z = Q z + K^T T^-1 B^-1 T^-1 K r
        self._rows.mult(z, right)
        right.array_w[:] -= self._compliance * forces.array_r
        self._factor.solve(right, self._forces_change)
        self._scaled.multTranspose(self._forces_change, change)
        z.axpy(-1.0, change)

    def add_stiff(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """``y += C^T B C x``."""
        self._rows.mult(x, self._right)
        self._right.array_w[:] /= self._compliance
        self._rows.multTransposeAdd(self._right, y, y)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        if self._factor is not None:
            destroy_ksp(self._factor)
        for item in (
            self._rows,
            self._scaled,
            self._coupling,
            self._change,
            self._right,
            self._forces,
            self._forces_change,
        ):
            item.destroy()


def _inverse_blocks(matrix: PETSc.Mat) -> PETSc.Mat:
    """The inverses of the diagonal blocks of a matrix, as a matrix; collective."""
    size = matrix.getBlockSize()
    # PETSc's own function returns the blocks of the first values again.
    counts, columns, values = matrix.getDiagonalBlock().getValuesCSR()
    rows = np.repeat(np.arange(len(counts) - 1), np.diff(counts))
    is_inside = rows // size == columns // size
    rows, columns = rows[is_inside], columns[is_inside]
    blocks = np.zeros(((len(counts) - 1) // size, size, size))
    blocks[rows // size, rows % size, columns % size] = values[is_inside]
    blocks = np.linalg.inv(blocks)
    first, last = matrix.getOwnershipRange()
    starts = np.arange(0, blocks.size + 1, size, dtype=PETSc.IntType)
    nodes = np.arange(first, last, size, dtype=PETSc.IntType)
    columns = nodes[:, None, None] + np.arange(size, dtype=PETSc.IntType)[None, None, :]
    columns = np.broadcast_to(columns, blocks.shape)
    sizes: Any = (matrix.getLocalSize()[0], None)
    return PETSc.Mat().createAIJ(
        (sizes, sizes), csr=(starts, columns.reshape(-1), blocks.reshape(-1)), comm=matrix.getComm()
    )
