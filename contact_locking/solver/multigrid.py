"""Algebraic multigrid with filtering: a preconditioner that locked zones do not slow down.

A locked cell is stiff along one strain and soft along all others, with a contrast that grows
without bound, which no algebraic coarsening sees.  The filter therefore takes the stiff part out:
with ``F`` the exact solve on the degrees of freedom of stiff cells and nodes, and ``G`` a multigrid
cycle for the matrix without their stiffness, the preconditioner is

    B = F + (I - F A) G (I - A F),

symmetric and positive definite whatever ``G`` misses (:class:`Filter`).  A residual that vanishes
on the filtered degrees of freedom keeps doing so, and for it ``B = (I - F A) G``: one exact solve,
not two.  A variant of doi:10.48550/arXiv.2505.18576.

Where more is stiff than can be filtered, the multigrid for the matrix without the stiffness of
points along single directions is projected instead (:class:`Projection`).

Without either, ``B`` is a multigrid cycle for ``A`` itself, which is faster as long as no cell
is much stiffer than others; the iterations grow like the square root of the contrast.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.solver.ksp import (
    PREFIX,
    InsertedOptions,
    Unblocked,
    create_ksp,
    destroy_ksp,
    direct_options,
    multigrid_options,
)

_PREFIX = PREFIX + "multigrid_"
# The zones move but the mesh does not: only values are made anew.
_ALGEBRAIC: dict[str, Any] = {"pc_gamg_reuse_interpolation": True}
# Relaxation sees the matrix in blocks, Galerkin products its copy without them.
_FINEST: dict[str, Any] = {"pc_use_amat": True}
_COARSE = "mg_coarse_"


class CoarserSpace(NamedTuple):
    """A part of the space, with the prolongation from it, and the rigid motions in it.

    Algebraic coarsening of quadratic elements takes twice the iterations of that of affine ones,
    as midpoints of edges and corners are nodes of different kinds.
    """

    prolongation: PETSc.Mat
    near_nullspace: PETSc.NullSpace


class Cycle:
    """``G``, one cycle of multigrid for the values of a matrix; all of it is collective.

    ``coarser`` is the space below the matrix's own, if there is one: relaxation on the finest
    level, and algebraic multigrid for the Galerkin product below.  Without it, or where the user
    wants another preconditioner, PETSc coarsens the matrix itself.  ``overrides`` are options of
    the user.
    """

    def __init__(
        self, comm: Any, coarser: CoarserSpace | None, overrides: Mapping[str, Any]
    ) -> None:
        self._pc = PETSc.PC().create(comm)
        self._product: PETSc.Mat | None = None
        algebraic = multigrid_options() | _ALGEBRAIC
        options = algebraic | _FINEST
        if coarser is not None:
            below = {_COARSE + name: value for name, value in algebraic.items()}
            above = {name: algebraic[name] for name in algebraic if name.startswith("mg_levels_")}
            options = {"pc_type": "mg", _COARSE + "ksp_type": "preonly"} | below | above | _FINEST
        self._options = InsertedOptions([self._pc], options, overrides, _PREFIX)
        self._coarser = coarser if self._pc.getType() == PETSc.PC.Type.MG else None
        if self._coarser is not None:
            # The levels take the prefix that the options have by now.
            self._pc.setMGLevels(2)
            self._pc.setMGInterpolation(1, self._coarser.prolongation)

    def set_up(self, matrix: PETSc.Mat, by_entry: PETSc.Mat) -> None:
        """Take the present values of a matrix in blocks and of its copy ``by_entry``."""
        self._pc.setOperators(matrix, by_entry)
        if self._coarser is not None:
            self._product = by_entry.ptap(self._coarser.prolongation, self._product)
            self._product.setNearNullSpace(self._coarser.near_nullspace)
            # PETSc forgets it with each new value.
            self._product.setOption(PETSc.Mat.Option.SPD, True)
            self._pc.getMGCoarseSolve().setOperators(self._product)
        self._pc.setUp()

    def apply(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """``z = G r``."""
        self._pc.apply(r, z)

    def destroy(self) -> None:
        """Free the PETSc objects but those of ``coarser``."""
        self._options.remove()
        self._pc.destroy()
        if self._product is not None:
            self._product.destroy()


class Projection:
    """Projection onto the displacements that no stiff point of the body or of contact resists.

    With ``A = A_0 + C^T B C``, where each row of ``C`` takes the strain of a point of a cell, or
    the displacement of a point of contact, along a direction in which the point is stiff, and ``B``
    holds these stiffnesses, the projection is

        Q = I - K^T T^-1 C,    K = C D^-1,    T = C K^T + B^-1,

    with ``D`` the diagonal blocks of ``A_0``.  For a preconditioner ``G`` of the soft matrix,

        Q G Q^T + K^T T^-1 B^-1 T^-1 K

    preconditions ``A`` for any stiffness: B stands in it as ``B^-1`` only, and ``Q`` depends on it
    less, the larger it is.  T has one row for each stiff point, a scalar each: to factorise T
    costs a small part of what factorising the stiff part of A does.  How well ``Q`` keeps the
    energy of smooth displacements decides about the number of iterations; compare the least-squares
    commutators of doi:10.1137/040608817, which contain the same matrix ``C D^-1 C^T``.

    All of it is collective.

    ``rows`` is C, (k, n), whose columns of constrained unknowns are zero, and ``stiffness`` (k,)
    the diagonal of B, > 0, on this rank.  ``soft`` is ``A_0``, stored by entry, with blocks of the
    components of a node.  The projection owns ``rows``.
    """

    def __init__(
        self,
        rows: PETSc.Mat,
        stiffness: FloatArray,
        soft: PETSc.Mat,
        overrides: Mapping[str, Any],
    ) -> None:
        # C, the diagonal of B^-1, and K.
        self._rows, self._compliance = rows, 1.0 / stiffness
        inverse = _inverse_blocks(soft)
        self._scaled = rows.matMult(inverse)
        inverse.destroy()
        columns = PETSc.Mat()
        rows.transpose(columns)
        self._coupling = self._scaled.matMult(columns)
        columns.destroy()
        self._change, self._right = rows.createVecs()
        self._forces, self._forces_change = self._right.duplicate(), self._right.duplicate()
        self._vectors = self._change, self._right, self._forces, self._forces_change
        self._right.array_w[:] = self._compliance
        self._coupling.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        self._coupling.setDiagonal(self._right, PETSc.InsertMode.ADD_VALUES)
        self._coupling.setOption(PETSc.Mat.Option.SPD, True)
        # None where nothing is stiff.
        self._factor: PETSc.KSP | None = None
        if rows.getSize()[0] > 0:
            comm = rows.getComm()
            self._factor = create_ksp(comm, direct_options(comm), overrides, PREFIX + "projection_")
            self._factor.setOperators(self._coupling)
            self._factor.setUp()

    def apply(self, soft: Cycle, r: PETSc.Vec, z: PETSc.Vec, vanishes: bool) -> None:
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

    def multiply(self, soft: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """``y = A x = A_0 x + C^T B C x`` with ``soft`` for ``A_0``: A itself needs no values."""
        soft.mult(x, y)
        self._rows.mult(x, self._right)
        self._right.array_w[:] /= self._compliance
        self._rows.multTransposeAdd(self._right, y, y)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        if self._factor is not None:
            destroy_ksp(self._factor)
        for petsc_object in (self._rows, self._scaled, self._coupling, *self._vectors):
            petsc_object.destroy()


def _inverse_blocks(matrix: PETSc.Mat) -> PETSc.Mat:
    """The inverses of the diagonal blocks of a matrix, as a matrix; collective."""
    # PETSc's own function returns the blocks of the first values again.
    size, (first, last) = matrix.getBlockSize(), matrix.getOwnershipRange()
    starts, columns, values = matrix.getDiagonalBlock().getValuesCSR()
    shape = last - first, last - first
    nodal = sp.csr_matrix((values, columns, starts), shape).tobsr((size, size))
    nodes = np.arange(shape[0] // size)
    is_diagonal = nodal.indices == np.repeat(nodes, np.diff(nodal.indptr))
    blocks = np.linalg.inv(nodal.data[is_diagonal])
    inverse = sp.bsr_matrix((blocks, nodes, np.arange(len(nodes) + 1)), shape).tocsr()
    csr = [part.astype(PETSc.IntType) for part in (inverse.indptr, inverse.indices + first)]
    sizes = matrix.getSizes()
    return PETSc.Mat().createAIJ(sizes, csr=(*csr, inverse.data), comm=matrix.getComm())


# A filter that is larger than it need be by this factor is made anew.
_WASTE = 1.2


class StiffPart(NamedTuple):
    """The stiff part of a matrix.

    ``nodes`` are the local numbers of its owned nodes; ``find_nearly`` finds them together with
    those that may soon be stiff, too; ``assemble_rest`` gives another matrix of the same pattern
    the values without what is stiff.  ``find_rows`` returns the rows C and the stiffness B of
    :class:`Projection`, for points that are still stiffer, and ``assemble_across`` assembles the
    matrix without ``C^T B C``.  All are collective.
    """

    nodes: IndexArray
    find_nearly: Callable[[], IndexArray]
    assemble_rest: Callable[[PETSc.Mat], None]
    find_rows: Callable[[], tuple[PETSc.Mat, FloatArray]]
    assemble_across: Callable[[PETSc.Mat], None]


class Filter:
    """``B`` with the exact solve ``F`` on the unknowns of some nodes; all of it is collective.

    ``matrix`` is A, in blocks, and ``nodes`` are local numbers of owned nodes.  Ordering, symbolic
    factorisation and memory are those of the first values, and serve all that follow.
    """

    def __init__(self, matrix: PETSc.Mat, nodes: IndexArray, overrides: Mapping[str, Any]) -> None:
        self._matrix, self._nodes = matrix, nodes
        self._comm, size = matrix.getComm(), matrix.getBlockSize()
        first = matrix.getOwnershipRange()[0] // size
        self._unknowns = (nodes[:, None] * size + np.arange(size)).reshape(-1)
        numbers = (nodes + first).astype(PETSc.IntType)
        self._rows = PETSc.IS().createBlock(size, numbers, comm=self._comm)
        self._unblocked = Unblocked()
        self._right = PETSc.Vec().create(self._comm)
        self._right.setSizes((len(self._unknowns), None))
        self._right.setUp()
        self._exact = self._right.duplicate()
        self._moved, self._left = matrix.createVecs()
        options = direct_options(self._comm)
        self._ksp = create_ksp(self._comm, options, overrides, PREFIX + "filter_")

    def serves(self, nodes: IndexArray) -> bool:
        """Whether it takes in these nodes, and few others."""
        missing = len(np.setdiff1d(nodes, self._nodes, assume_unique=True))
        local = np.array([missing, len(nodes), len(self._nodes)])
        counts = self._comm.tompi4py().allreduce(local)
        return bool(counts[0] == 0 and counts[2] <= _WASTE * counts[1])

    def refresh(self) -> None:
        """Factorise the present values of the matrix."""
        # A matrix of several ranks in blocks refuses to take the same part into the same matrix.
        block = self._matrix.createSubMatrix(self._rows, self._rows)
        self._ksp.setOperators(self._unblocked.of(block))
        block.destroy()
        self._ksp.setUp()

    def start(self, right: PETSc.Vec, x: PETSc.Vec) -> None:
        """Change ``x`` so that ``right - A x`` vanishes where filtered."""
        self._matrix.mult(x, self._left)
        self._left.aypx(-1.0, right)
        self._add(1.0, self._left, x)

    def apply(self, soft: Cycle, r: PETSc.Vec, z: PETSc.Vec, vanishes: bool) -> None:
        """``z = B r`` with ``soft`` for G; ``vanishes`` says that r does where filtered."""
        if not vanishes:
            self._moved.set(0.0)
            self._add(1.0, r, self._moved)
            self._matrix.mult(self._moved, self._left)
            self._left.aypx(-1.0, r)
        soft.apply(r if vanishes else self._left, z)
        self._matrix.mult(z, self._left)
        self._add(-1.0, self._left, z)
        if not vanishes:
            z.axpy(1.0, self._moved)

    def multiply(self, soft: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """``y = A x``."""
        self._matrix.mult(x, y)

    def _add(self, factor: float, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """``z += factor F r``."""
        self._right.array_w[:] = r.array_r[self._unknowns]
        self._ksp.solve(self._right, self._exact)
        z.array_w[self._unknowns] += factor * self._exact.array_r

    def destroy(self) -> None:
        """Free the PETSc objects."""
        destroy_ksp(self._ksp)
        self._unblocked.destroy()
        for petsc_object in (self._rows, self._right, self._exact, self._moved, self._left):
            petsc_object.destroy()


class FilteredMultigrid:
    """The preconditioner ``B`` for the values of a matrix; all of it is collective.

    ``matrix`` is stored in blocks (BAIJ), in which products take half the time, and has its
    near-nullspace.  ``limit`` is the most that may be filtered; more is projected.  ``coarser`` is
    what :class:`Cycle` takes, and belongs to this object.  ``overrides`` are options of the user.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        limit: int,
        coarser: CoarserSpace | None = None,
        overrides: Mapping[str, Any] | None = None,
    ) -> None:
        self._matrix, self._limit, self._coarser = matrix, limit, coarser
        self._overrides = overrides or {}
        self._unblocked = Unblocked()
        self._smoothed = matrix
        self._cycle = Cycle(matrix.getComm(), coarser, self._overrides)
        self._soft: PETSc.Mat | None = None
        #: What takes the stiff part out at present.
        self.helper: Filter | Projection | None = None

    def count(self, nodes: IndexArray) -> int:
        """The unknowns of owned nodes on all ranks."""
        count: int = self._matrix.getComm().tompi4py().allreduce(len(nodes))
        return count * self._matrix.getBlockSize()

    def must_project(self, stiff: StiffPart) -> bool:
        """Whether more is stiff than may be filtered."""
        return self.count(stiff.nodes) > self._limit

    def refresh(self, stiff: StiffPart | None = None) -> None:
        """Set up for the present values of the matrix.

        Without ``stiff`` the multigrid is for the matrix to be solved with, and nothing is
        filtered.
        """
        projects = stiff is not None and self.must_project(stiff)
        # Factors are free before multigrid takes memory for the new values.
        last = self.helper if stiff is not None and not projects else None
        if stiff is None or not (isinstance(last, Filter) and last.serves(stiff.nodes)):
            self._release()
        smoothed = self._matrix if stiff is None else self._without(stiff, projects)
        # The residuals of its finest level stay those of the first matrix that it was given.
        if smoothed is not self._smoothed:
            self._cycle.destroy()
            self._smoothed = smoothed
            self._cycle = Cycle(self._matrix.getComm(), self._coarser, self._overrides)
        by_entry = self._unblocked.of(smoothed)
        self._cycle.set_up(smoothed, by_entry)
        if stiff is not None and projects:
            self.helper = Projection(*stiff.find_rows(), by_entry, self._overrides)
        elif stiff is not None:
            if not isinstance(self.helper, Filter):
                # Nodes that will soon be stiff are taken in if they are few.
                nearly = stiff.find_nearly()
                most = min(_WASTE * self.count(stiff.nodes), self._limit)
                nodes = nearly if self.count(nearly) <= most else stiff.nodes
                self.helper = Filter(self._matrix, nodes, self._overrides)
            self.helper.refresh()

    def multiply(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """``y = A x`` for an x that is zero where displacements are prescribed."""
        if self.helper is None:
            self._matrix.mult(x, y)
        else:
            self.helper.multiply(self._smoothed, x, y)

    def start(self, right: PETSc.Vec, x: PETSc.Vec) -> None:
        """Change ``x`` so that ``right - A x`` vanishes where filtered."""
        if isinstance(self.helper, Filter):
            self.helper.start(right, x)

    def apply(self, r: PETSc.Vec, z: PETSc.Vec, vanishes: bool = False) -> None:
        """``z = B r``; ``vanishes`` says that the residual does where filtered."""
        if self.helper is None:
            self._cycle.apply(r, z)
        else:
            self.helper.apply(self._cycle, r, z, vanishes)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._release()
        self._cycle.destroy()
        if self._coarser is not None:
            self._coarser.prolongation.destroy()
            self._coarser.near_nullspace.destroy()
        if self._soft is not None:
            self._soft.destroy()
        self._unblocked.destroy()

    def _without(self, stiff: StiffPart, projects: bool) -> PETSc.Mat:
        """The matrix without the stiffness of what is filtered or projected."""
        if self._soft is None:
            self._soft = self._matrix.duplicate()
            self._soft.setNearNullSpace(self._matrix.getNearNullSpace())
        (stiff.assemble_across if projects else stiff.assemble_rest)(self._soft)
        return self._soft

    def _release(self) -> None:
        """Free the projection or the filter."""
        if self.helper is not None:
            self.helper.destroy()
            self.helper = None
