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

Where T is factorised in pieces, single precision takes half the memory and half the time.  But an
error of ``C z`` counts B times in ``A z``.  So the forces ``B C z`` become unknowns of their own,
for which single precision is enough (:mod:`saddle_point`).  Where ``A`` itself needs more digits of
``T^-1``, CG finds them with the factor as its preconditioner.  The locked points become nearly
dependent in the last tangents, for which double precision is faster again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.arrays import FloatArray
from contact_locking.solver.linear.direct import Substructuring
from contact_locking.solver.linear.ksp import create_ksp, destroy_ksp, direct_options
from contact_locking.solver.linear.multigrid import Multigrid
from contact_locking.solver.linear.options import PREFIX

# CG for T leaves this share of what its right-hand side is over the largest stiffness, in units of
# the material, so that the forces B C z are as precise as GMRES has made the others.
_SHARE_OF_STIFF = 0.1
_SHARPEST = 1e-14
# A factor with which CG takes more iterations than these is a bad one: GMRES takes more, too.
_BAD = 6
_PRECISE: dict[str, Any] = {
    "ksp_type": "cg",
    "ksp_norm_type": "unpreconditioned",
    "ksp_max_it": 100,
}


class Projection:
    """``Q`` for one matrix; all of it is collective.

    ``rows`` is C, (k, n), whose columns of constrained unknowns are zero, and ``stiffness`` (k,)
    the diagonal of B, > 0, on this rank.  ``soft`` is ``A_0``, stored by entry, with blocks of the
    components of a node.  The projection owns ``rows``.  ``in_single`` lets T be factorised in
    single precision.
    """

    def __init__(
        self, rows: PETSc.Mat, stiffness: FloatArray, soft: PETSc.Mat, in_single: bool = False
    ) -> None:
        #: C.
        self.rows = rows
        #: The diagonal of B^-1, (k,).
        self.compliance = 1.0 / stiffness
        inverse = _inverse_blocks(soft)
        #: K.
        self.scaled = rows.matMult(inverse)
        inverse.destroy()
        columns = PETSc.Mat()
        rows.transpose(columns)
        self._coupling = self.scaled.matMult(columns)
        columns.destroy()
        diagonal = self._coupling.getDiagonal()
        diagonal.array_w[:] += self.compliance
        self._coupling.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        self._coupling.setDiagonal(diagonal)
        self._coupling.setOption(PETSc.Mat.Option.SPD, True)
        #: The diagonal of T, (k,).
        self.diagonal = diagonal.array_r.copy()
        diagonal.destroy()
        self._change, self._right = rows.createVecs()
        self._forces, self._forces_change = self._right.duplicate(), self._right.duplicate()
        self._nothing = self._right.duplicate()
        self._nothing.set(0.0)
        #: How many unknowns a node has.
        self.block_size = soft.getBlockSize()
        #: Whether nothing is stiff.
        self.is_empty = rows.getSize()[0] == 0
        # The factor of T, and behind it CG with the factor where that is in single precision.
        self._solvers: list[PETSc.KSP] = []
        #: Whether T is factorised in single precision.
        self.in_single = False
        #: Whether a solve has shown that a factor in single precision is a bad one.
        self.is_bad = False
        if not self.is_empty:
            self._factorise(in_single)

    def apply(self, soft: Multigrid, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """``z = B r`` with ``soft`` in the place of G."""
        if self.is_empty:
            soft.apply(r, z)
            return
        self._invert(self._solve_precisely, soft, r, self._nothing, z, self._forces)

    def invert(
        self, soft: Multigrid, r: PETSc.Vec, s: PETSc.Vec, z: PETSc.Vec, forces: PETSc.Vec
    ) -> None:
        """Find z and forces f by which ``A_0 z + C^T f`` is about r, and ``C z - B^-1 f`` is s.

        With ``soft`` in the place of G, and the factor of T as precise as it is.
        """
        self._invert(self._solvers[0].solve, soft, r, s, z, forces)

    def disagreement(self, z: PETSc.Vec, forces: PETSc.Vec, s: PETSc.Vec) -> None:
        """``s = C z - B^-1 f``: how far forces are from those of a displacement."""
        self.rows.mult(z, s)
        s.array_w[:] -= self.compliance * forces.array_r

    def reconcile(self, z: PETSc.Vec, forces: PETSc.Vec) -> None:
        """Change z and forces f so that ``C z = B^-1 f``, as precisely as the stiffness needs."""
        self._reconcile(self._solve_precisely, self._nothing, z, forces)

    def add_stiff(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """``y += C^T B C x``."""
        self.rows.mult(x, self._right)
        self._right.array_w[:] /= self.compliance
        self.rows.multTransposeAdd(self._right, y, y)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        for solver in reversed(self._solvers):
            destroy_ksp(solver)
        for item in (
            self.rows,
            self.scaled,
            self._coupling,
            self._change,
            self._right,
            self._forces,
            self._forces_change,
            self._nothing,
        ):
            item.destroy()

    def _invert(
        self,
        solve: Callable[[PETSc.Vec, PETSc.Vec], None],
        soft: Multigrid,
        r: PETSc.Vec,
        s: PETSc.Vec,
        z: PETSc.Vec,
        forces: PETSc.Vec,
    ) -> None:
        change, right = self._change, self._right
        self.scaled.mult(r, right)
        right.axpy(-1.0, s)
        solve(right, forces)
        # z = G Q^T r
        self.rows.multTranspose(forces, change)
        change.aypx(-1.0, r)
        soft.apply(change, z)
        # z = Q z + K^T T^-1 B^-1 T^-1 K r
        self._reconcile(solve, s, z, forces)

    def _reconcile(
        self,
        solve: Callable[[PETSc.Vec, PETSc.Vec], None],
        s: PETSc.Vec,
        z: PETSc.Vec,
        forces: PETSc.Vec,
    ) -> None:
        """Change z and forces f so that ``C z - B^-1 f`` is s."""
        change, right, forces_change = self._change, self._right, self._forces_change
        self.disagreement(z, forces, right)
        right.axpy(-1.0, s)
        solve(right, forces_change)
        self.scaled.multTranspose(forces_change, change)
        z.axpy(-1.0, change)
        forces.axpy(1.0, forces_change)

    def _solve_precisely(self, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        """``T^-1 b``, as precise as the stiffness needs."""
        precise = self._solvers[-1]
        precise.solve(right, solution)
        self.is_bad |= self.in_single and precise.getIterationNumber() > _BAD

    def _factorise(self, in_single: bool) -> None:
        """The factor of T, and CG with the factor if that is in single precision."""
        comm = self._coupling.getComm()
        factor = create_ksp(comm, direct_options(comm), prefix=PREFIX + "projection_")
        self._solvers = [factor]
        factor.setOperators(self._coupling)
        if not (in_single and factor.getPC().getType() == PETSc.PC.Type.PYTHON):
            factor.setUp()
            return
        pieces = Substructuring(np.float32)
        factor.getPC().setPythonContext(pieces)
        try:
            factor.setUp()
        except PETSc.Error:
            # Rounding may have made T indefinite; double precision fails as well for other reasons.
            self.is_bad = True
            destroy_ksp(factor)
            self._factorise(in_single=False)
            return
        self.in_single = pieces.in_pieces
        if self.in_single:
            precise = create_ksp(comm, _PRECISE, prefix=PREFIX + "projection_precise_")
            self._solvers.append(precise)
            precise.setErrorIfNotConverged(False)
            precise.setOperators(self._coupling)
            precise.setPC(factor.getPC())
            largest = float(np.max(self.diagonal / self.compliance, initial=1.0))
            largest = comm.tompi4py().allreduce(largest, op=MPI.MAX)
            precise.setTolerances(rtol=max(_SHARE_OF_STIFF / largest, _SHARPEST), atol=0.0)


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
