"""The tangent with the forces of its stiff points as unknowns of their own.

With ``A = A_0 + C^T B C`` (:mod:`projection`), ``(A + F) z = r`` is

    [ A_0 + F    C^T  ] [ z ]   [ r ]
    [    C      -B^-1 ] [ f ] = [ 0 ]

in which the stiffness B stands as a compliance: an error of ``C z`` no longer counts B times.  The
preconditioner, which makes forces and displacement agree with each other, may therefore be as
inexact as a factor in single precision, and GMRES takes as many iterations as for ``A``.  After
GMRES the displacement is made to agree with the forces in full precision, once for each solve.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.solver.linear.filtered_multigrid import FilteredMultigrid
from contact_locking.solver.linear.projection import Projection
from contact_locking.solver.linear.tangent_solver import Follow


class SaddlePoint:
    """The system of ``multigrid``, which projects; all of it is collective.

    It is the context of the matrix and of the preconditioner.  Vectors have this rank's part of
    ``z``, then that of the forces.  The rows of the forces are scaled so that their residual is
    comparable with forces at the nodes.
    """

    def __init__(self, multigrid: FilteredMultigrid, projection: Projection) -> None:
        self._multigrid, self._projection = multigrid, projection
        self._z, self._forces = projection.rows.createVecs()
        self._r, self._s = self._z.duplicate(), self._forces.duplicate()
        self._at_nodes = _RowsAtNodes(projection)
        norms = _norms(projection.rows)
        self._scale = np.where(norms > 0.0, norms, 1.0) / projection.diagonal
        #: The forces F, if there are any.
        self.follow: Follow | None = None
        #: How many unknowns this rank has, displacements and forces.
        self.size = self._z.getLocalSize() + self._forces.getLocalSize()

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """The product with the matrix."""
        projection, z, forces = self._projection, self._z, self._forces
        self._split(x, z, forces)
        self._multigrid.soft.mult(z, self._r)
        projection.rows.multTransposeAdd(forces, self._r, self._r)
        projection.disagreement(z, forces, self._s)
        if self.follow is not None:
            self._at_nodes.reconcile(self._s, z)
            self.follow(z, self._r)
        self._s.array_w[:] *= self._scale
        self._join(self._r, self._s, y)

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """The preconditioner."""
        self._split(x, self._r, self._s)
        self._s.array_w[:] /= self._scale
        self._multigrid.invert(self._r, self._s, self._z, self._forces)
        self._join(self._z, self._forces, y)

    def set_right(self, forces: PETSc.Vec, right: PETSc.Vec) -> None:
        """The right-hand side of forces at the nodes."""
        self._s.set(0.0)
        self._join(forces, self._s, right)

    def add_displacement(self, solution: PETSc.Vec, x: PETSc.Vec) -> None:
        """Add the displacement of a solution, made to agree with the solution's forces, to x."""
        self._split(solution, self._z, self._forces)
        self._projection.reconcile(self._z, self._forces)
        x.axpy(1.0, self._z)

    # PETSc calls a context's ``destroy`` with its matrix, and with its preconditioner.
    def free(self) -> None:
        """Free the PETSc objects."""
        for item in (self._z, self._forces, self._r, self._s):
            item.destroy()

    def _split(self, x: PETSc.Vec, z: PETSc.Vec, forces: PETSc.Vec) -> None:
        count = z.getLocalSize()
        z.array_w[:] = x.array_r[:count]
        forces.array_w[:] = x.array_r[count:]

    def _join(self, z: PETSc.Vec, forces: PETSc.Vec, x: PETSc.Vec) -> None:
        count = z.getLocalSize()
        with x as joined:
            joined[:count] = z.array_r
            joined[count:] = forces.array_r


class _RowsAtNodes:
    """Rows that have entries at one node of this rank each, as those of contact have.

    The forces F that follow the displacement come from the pressure B C z at points of contact, in
    which errors of C z count B times, so that displacement and forces have to agree there.  With
    D by blocks of a node, T couples such rows only if they are at the same node.
    """

    def __init__(self, projection: Projection) -> None:
        rows = projection.rows
        size = projection.block_size
        first, last = rows.getOwnershipRangeColumn()
        chosen = _at_one_node(rows, size, first, last)
        self._chosen = chosen
        points, scaled = (
            _local(matrix, chosen, first, last) for matrix in (rows, projection.scaled)
        )
        self._spread = scaled.T.tocsr()
        self._coupling = None
        if len(chosen):
            coupling = points @ self._spread + sp.diags(projection.compliance[chosen])
            self._coupling = scipy.sparse.linalg.splu(coupling.tocsc())

    def reconcile(self, disagreement: PETSc.Vec, z: PETSc.Vec) -> None:
        """Change z so that the forces of these rows are those of the displacement."""
        if self._coupling is not None:
            forces = self._coupling.solve(disagreement.array_r[self._chosen])
            z.array_w[:] -= self._spread @ forces


def _norms(rows: PETSc.Mat) -> FloatArray:
    """The norms of the rows on this rank."""
    starts, _, values = rows.getValuesCSR()
    of_row = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    return np.sqrt(np.bincount(of_row, values**2, minlength=len(starts) - 1))


def _at_one_node(rows: PETSc.Mat, size: int, first: int, last: int) -> IndexArray:
    """The rows on this rank whose columns are those of one node of this rank."""
    starts, columns, _ = rows.getValuesCSR()
    filled = np.flatnonzero(np.diff(starts))
    if not len(filled):
        return filled.astype(np.int32)
    lowest, highest = (
        extreme.reduceat(columns, starts[filled]) for extreme in (np.minimum, np.maximum)
    )
    is_one = lowest // size == highest // size
    chosen = filled[is_one & (lowest >= first) & (highest < last)]
    return chosen.astype(np.int32)


def _local(matrix: PETSc.Mat, chosen: IndexArray, first: int, last: int) -> sp.csr_matrix:
    """Chosen rows of a matrix, with the columns of this rank."""
    starts, columns, values = matrix.getValuesCSR()
    shape = len(starts) - 1, matrix.getSize()[1]
    every = sp.csr_matrix((values, columns, starts), shape=shape)
    return every[chosen][:, first:last]
