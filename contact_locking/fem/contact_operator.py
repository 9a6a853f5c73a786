"""The displacements at the points of a contact, and the forces and stiffnesses that act there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


class ContactOperator:
    """``T``: a displacement u to the vectors ``(T u)_i = sum_a T_ia u_a`` at the k points i.

    ``rows`` (k, N) has the entries ``T_ia`` of the points of this rank, for all N blocks a of the
    displacements in ``space``, by their global numbers.  A row is that of a nodal value, of a
    control value of quadratic displacements, or of a jump between two bodies; a row without entries
    is a point where nothing acts.  Its blocks may belong to other ranks, and with ``couples_cells``
    to different cells.  All methods are collective.
    """

    def __init__(
        self, space: fem.FunctionSpace, rows: csr_matrix, couples_cells: bool = False
    ) -> None:
        self.couples_cells = couples_cells
        index_map = space.dofmap.index_map
        self.comm, self.dim = space.mesh.comm, space.dofmap.index_map_bs
        self._range, self._owned = index_map.local_range, index_map.size_local * self.dim
        self._vector = PETSc.Vec().createMPI(
            (self._owned, index_map.size_global * self.dim), bsize=self.dim, comm=self.comm
        )
        self._join(rows)

    def _join(self, rows: csr_matrix) -> None:
        from scipy.sparse import csr_matrix

        #: The entries ``T_ia`` by global blocks.
        self.rows = rows
        blocks, places = np.unique(rows.indices, return_inverse=True)
        shape = (rows.shape[0], len(blocks))
        #: The same by the numbers of the blocks among those of :meth:`at_blocks`.
        self.local = csr_matrix((rows.data, places.reshape(-1), rows.indptr), shape=shape)
        is_nodal = len(rows.data) == rows.shape[0] and bool(np.all(rows.data == 1.0))
        # Nodal values are picked by their places: a sparse product takes longer.
        self._nodal = self.local.indices if is_nodal and np.all(np.diff(rows.indptr)) else None
        self._gathered = PETSc.Vec().createSeq(self.dim * len(blocks), bsize=self.dim)
        taken = PETSc.IS().createBlock(self.dim, blocks.astype(PETSc.IntType), PETSc.COMM_SELF)
        self._scatter = PETSc.Scatter().create(self._vector, taken, self._gathered, None)
        taken.destroy()

    def join(self, rows: csr_matrix) -> None:
        """Replace the entries, after the bodies were paired anew."""
        self._gathered.destroy()
        self._scatter.destroy()
        self._join(rows)

    def values(self, displacement: FloatArray) -> FloatArray:
        """``T u`` (k, d) of local values of a displacement, of which only the owned ones count."""
        at_blocks = self.at_blocks(displacement)
        return np.asarray(self.local @ at_blocks if self._nodal is None else at_blocks[self._nodal])

    def add_forces(self, at_points: FloatArray, forces: PETSc.Vec) -> None:
        """``forces += T^T f`` for forces f (k, d) at the points."""
        if self._nodal is None:
            self._gathered.array_w[:] = (self.local.T @ at_points).reshape(-1)
        else:
            self._gathered.array_w.reshape(-1, self.dim)[self._nodal] = at_points
        self._scatter.scatter(
            self._gathered, forces, PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE
        )

    def forces(self, at_points: FloatArray) -> FloatArray:
        """``T^T f`` at the owned dofs for forces f (k, d) at the points."""
        self._vector.set(0.0)
        self.add_forces(at_points, self._vector)
        return np.array(self._vector.array_r)

    def pattern(self, like: PETSc.Mat) -> PETSc.Mat:
        """A matrix with the pattern of a :class:`PointStiffness`, which the caller destroys."""
        matrix = PETSc.Mat().create(self.comm)
        matrix.setSizes(like.getSizes())
        matrix.setBlockSize(self.dim)
        matrix.setType(PETSc.Mat.Type.AIJ)
        matrix.setUp()
        ones = np.ones((self.rows.shape[0], self.dim, self.dim))
        PointStiffness(self, ones).add_to(matrix, np.ones(self._owned))
        matrix.assemble()
        return matrix

    def along(self, points: IndexArray, directions: FloatArray) -> PETSc.Mat:
        """The matrix of ``u -> directions . T u`` at some points (p,), for directions (p, d)."""
        rows = self.rows[points]
        number = np.repeat(np.arange(len(points)), np.diff(rows.indptr))
        columns = self.dim * rows.indices[:, None] + np.arange(self.dim)
        return PETSc.Mat().createAIJ(
            ((len(points), None), (self._owned, None)),
            csr=(
                (self.dim * rows.indptr).astype(PETSc.IntType),
                columns.reshape(-1).astype(PETSc.IntType),
                (rows.data[:, None] * directions[number]).reshape(-1),
            ),
            comm=self.comm,
        )

    def blocks_of(self, points: IndexArray) -> IndexArray:
        """The owned blocks, by local numbers, that points (p,) of any rank depend on."""
        every = np.concatenate(self.comm.allgather(np.unique(self.rows[points].indices)))
        low, high = self._range
        return (np.unique(every[(every >= low) & (every < high)]) - low).astype(np.int32)

    def at_blocks(self, values: FloatArray) -> FloatArray:
        """Owned values at the blocks of the rows, (b, d)."""
        self._vector.array_w[:] = values[: self._owned]
        self._scatter.scatter(self._vector, self._gathered)
        return np.array(self._gathered.array_r).reshape(-1, self.dim)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        for petsc_object in (self._vector, self._gathered, self._scatter):
            petsc_object.destroy()


@dataclass(frozen=True)
class PointStiffness:
    """``T^T D T`` of an operator T, with the ``blocks`` D (k, d, d) of its points."""

    operator: ContactOperator
    blocks: FloatArray

    def add_to(self, matrix: PETSc.Mat, free: FloatArray) -> None:
        """Add it to a matrix between free dofs, without assembling the matrix; collective.

        ``free`` is 1 at the free owned dofs, and 0 at the others.
        """
        local, mask = self.operator.local, self.operator.at_blocks(free)
        counts = np.diff(local.indptr)
        for count in np.unique(counts[counts > 0]):
            points = np.flatnonzero(counts == count)
            entries = local.indptr[points][:, None] + np.arange(count)
            shares = local.data[entries][..., None] * mask[local.indices[entries]]
            products = np.einsum("kap,kpq,kbq->kapbq", shares, self.blocks[points], shares)
            size = int(count) * self.operator.dim
            among = self.operator.rows.indices[entries].astype(PETSc.IntType)
            values = products.reshape(-1, size, size)
            matrix.setValuesBlockedRCV(among, among, values, PETSc.InsertMode.ADD)
