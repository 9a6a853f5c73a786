"""Displacements that are prescribed along directions that are no axes, eliminated exactly.

At a node with the held directions m_1, ..., m_r (unit vectors, orthonormalised) let ``H = sum m_i
m_i^T`` and ``P = I - H``, and let g be the displacement in the span of the directions that has the
prescribed components.  Then ``u = P u + g``.  With the P of all nodes, the free part of a residual
r is ``P r``, and the tangent A is replaced by ``P A P + s H`` with a stiffness s > 0 at each node,
which is symmetric and, on the free displacements, the tangent itself.  For a direction along an
axis these are the usual zero rows and columns with s on the diagonal.  Rounding in ``P A P``
couples the held directions with the free ones by a share of the stiffness of the node, which grows
without bound where the node sticks to a foundation.  So s is the stiffness of the node itself.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray


class HeldDirections:
    """The directions that are held at some nodes, with the displacements that they prescribe.

    ``nodes`` (k,) are local nodes (blocks of the displacement space), ghosts included, ``numbers``
    (k,) their global numbers, of which the rank owns those below ``owned`` nodes.  ``held``
    (k, d, d) are the projections H and ``values`` (k, d) the displacements g.
    """

    def __init__(
        self,
        comm: MPI.Intracomm,
        nodes: IndexArray,
        numbers: IndexArray,
        owned: int,
        held: FloatArray,
    ) -> None:
        self.nodes, self.held = nodes, held
        self.values: FloatArray = np.zeros(held.shape[:2])
        self._comm, self._numbers = comm, numbers
        self._owned, self._mine = owned, nodes < owned
        self._dim = held.shape[1]

    def project(self, values: FloatArray) -> None:
        """Take the held directions out of local or owned values of a displacement field."""
        blocks, held = self._of(values)
        nodal = values.reshape(-1, self._dim)
        nodal[blocks] -= np.einsum("kij,kj->ki", held, nodal[blocks])

    def part_of(self, values: FloatArray) -> FloatArray:
        """The components along held directions of local or owned values, and 0 elsewhere."""
        blocks, held = self._of(values)
        found = np.zeros_like(values)
        nodal = values.reshape(-1, self._dim)[blocks]
        found.reshape(-1, self._dim)[blocks] = np.einsum("kij,kj->ki", held, nodal)
        return found

    def apply(self, values: FloatArray) -> None:
        """Give local values the prescribed components along the held directions."""
        self.project(values)
        values.reshape(-1, self._dim)[self.nodes] += self.values

    def without(self, nodes: IndexArray) -> HeldDirections:
        """The same directions, but not at some local nodes."""
        kept = ~np.isin(self.nodes, nodes)
        found = HeldDirections(
            self._comm, self.nodes[kept], self._numbers[kept], self._owned, self.held[kept]
        )
        found.values = self.values[kept]
        return found

    def eliminate(self, matrix: PETSc.Mat, holds: bool = True) -> None:
        """Replace an assembled matrix A by ``P A P + s H``, or by ``P A P`` alone; collective.

        s is the largest entry on the diagonal of A at the node.  The pattern of the matrix is
        symmetric and has whole blocks of a node's components.
        """
        if not self._is_anywhere:
            return
        numbers, projections = self._everywhere
        dim, (first, _) = self._dim, matrix.getOwnershipRange()
        changes: list[tuple[IndexArray, IndexArray, FloatArray]] = []
        for place in np.flatnonzero(self._mine):
            node, held = self.nodes[place], self.held[place]
            start = first + dim * int(node)
            rows = [matrix.getRow(start + i) for i in range(dim)]
            columns = np.asarray(rows[0][0], dtype=PETSc.IntType).reshape(-1, dim)[:, 0] // dim
            if not len(columns):
                continue
            row = start // dim
            stacked = np.array([values for _, values in rows])
            blocks: FloatArray = stacked.reshape(dim, -1, dim)
            stiffness = float(np.einsum("ici->ic", blocks[:, columns == row]).max(initial=0.0))
            blocks = blocks - np.tensordot(held, blocks, axes=1)
            found = np.minimum(np.searchsorted(numbers, columns), len(numbers) - 1)
            both = numbers[found] == columns
            blocks[:, both] -= np.einsum("icj,cjl->icl", blocks[:, both], projections[found[both]])
            if holds:
                blocks[:, columns == row] += stiffness * held[:, None]
            own = np.array([row], dtype=PETSc.IntType)
            changes.append((own, columns, blocks.reshape(dim, -1)))
            # The owner of the other node sets the rows of that node if it holds a direction too.
            others = blocks[:, ~both]
            changes.append((columns[~both], own, others.transpose(1, 2, 0).reshape(-1, dim)))
        for lines, columns, values in changes:
            if len(lines) and len(columns):
                matrix.setValuesBlocked(
                    lines, columns, np.ascontiguousarray(values), PETSc.InsertMode.INSERT_VALUES
                )
        matrix.assemble()

    def projected_columns(self, rows: PETSc.Mat) -> PETSc.Mat:
        """``B P`` for linear forms B (n, k) of displacements; B is given away; collective."""
        if not self._is_anywhere:
            return rows
        from scipy.sparse import eye, lil_matrix

        dim, (first, last) = self._dim, rows.getOwnershipRangeColumn()
        projection = lil_matrix(eye(last - first, format="lil"))
        for place in np.flatnonzero(self._mine):
            own = dim * int(self.nodes[place]) + np.arange(dim)
            projection[np.ix_(own, own)] = np.eye(dim) - self.held[place]
        local = projection.tocsr()
        starts, columns = local.indptr, local.indices + first
        csr = (starts.astype(PETSc.IntType), columns.astype(PETSc.IntType), local.data)
        size = (last - first, None)
        matrix = PETSc.Mat().createAIJ((size, size), csr=csr, comm=rows.getComm())
        found = rows.matMult(matrix)
        for item in (matrix, rows):
            item.destroy()
        return found

    def _of(self, values: FloatArray) -> tuple[IndexArray, FloatArray]:
        """The nodes that an array of values has, and their projections."""
        inside = self.nodes < len(values) // self._dim
        return self.nodes[inside], self.held[inside]

    @cached_property
    def _everywhere(self) -> tuple[IndexArray, FloatArray]:
        """The global numbers, ascending, and projections of the nodes of all ranks; collective.

        A rank may own a row with a column of a node that it does not know.
        """
        numbers = np.concatenate(self._comm.allgather(self._numbers[self._mine]))
        held = np.concatenate(self._comm.allgather(self.held[self._mine]))
        order = np.argsort(numbers)
        return numbers[order], held[order]

    @cached_property
    def _is_anywhere(self) -> bool:
        """Whether any rank has such a node; collective."""
        return bool(len(self._everywhere[0]))
