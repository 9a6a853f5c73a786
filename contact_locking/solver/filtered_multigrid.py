"""Algebraic multigrid with filtering: a preconditioner that locked zones do not slow down.

A locked cell is stiff along one strain and soft along all others, with a contrast that grows
without bound, which no algebraic coarsening sees.  The filter therefore takes the stiff part out:
with ``F`` the exact solve on the degrees of freedom of stiff cells and nodes, and ``G`` a multigrid
cycle for the matrix without their stiffness, the preconditioner is

    B = F + (I - F A) G (I - A F),

symmetric and positive definite whatever ``G`` misses.  A residual that vanishes on the filtered
degrees of freedom keeps doing so, and for it ``B = (I - F A) G``: one exact solve, not two.  So
solves start from :meth:`FilteredMultigrid.start`.  A variant of doi:10.48550/arXiv.2505.18576.

Without the filter ``B`` is a multigrid cycle for ``A`` itself, which is faster as long as no cell
is much stiffer than others; the iterations grow like the square root of the contrast.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from contact_locking.solver.linear import (
    configure,
    create_ksp,
    destroy_ksp,
    direct_options,
    multigrid_options,
)
from contact_locking.solver.options import PREFIX
from contact_locking.solver.storage import BY_ENTRY, Unblocked

_CHANGES: dict[str, Any] = {
    # The zones move but the mesh does not: only values are made anew.
    "pc_gamg_reuse_interpolation": True,
    # Relaxation sees the matrix in blocks, Galerkin products its copy without them.
    "pc_use_amat": True,
}


class FilteredMultigrid:
    """The context of a PETSc preconditioner of type python.

    ``matrix`` is stored in blocks (BAIJ), in which products take half the time, and has its
    near-nullspace.  ``limit`` is the most that may be filtered.
    """

    def __init__(self, matrix: PETSc.Mat, limit: int) -> None:
        self._matrix, self._limit = matrix, limit
        self._unblocked = Unblocked()
        self._smoothed = matrix
        self._begin()
        self._product = matrix.createVecLeft()
        self._direct: PETSc.KSP | None = None
        self._soft: PETSc.Mat | None = None
        self._inner: list[Any] = []

    @property
    def filters(self) -> bool:
        """Whether the filter takes part at present."""
        return self._direct is not None

    @property
    def soft(self) -> PETSc.Mat:
        """A matrix for the values without the stiffness of what is filtered; collective."""
        if self._soft is None:
            self._soft = self._matrix.duplicate()
            self._soft.setNearNullSpace(self._matrix.getNearNullSpace())
        return self._soft

    def can_filter(self, filtered: npt.NDArray[np.int32]) -> bool:
        """Whether there are nodes to filter, and not more than the limit; collective."""
        count = self._matrix.getComm().tompi4py().allreduce(len(filtered))
        return 0 < count * self._matrix.getBlockSize() <= self._limit

    def refresh(self, filtered: npt.NDArray[np.int32] | None = None) -> None:
        """Set up for the present values of the matrices; collective.

        ``filtered`` are the local numbers of owned nodes; without them, the multigrid is for the
        matrix to be solved with, and nothing is filtered.
        """
        self._forget()
        smoothed = self._matrix if filtered is None else self.soft
        # The residuals of its finest level stay those of the first matrix that it was given.
        if smoothed is not self._smoothed:
            self._end()
            self._smoothed = smoothed
            self._begin()
        self._multigrid.setOperators(smoothed, self._unblocked.of(smoothed))
        self._multigrid.setUp()
        if filtered is None:
            return
        comm, size = self._matrix.getComm(), self._matrix.getBlockSize()
        first = self._matrix.getOwnershipRange()[0] // size
        self._filtered = (filtered[:, None] * size + np.arange(size)).reshape(-1)
        nodes = (filtered + first).astype(PETSc.IntType)
        rows = PETSc.IS().createBlock(size, nodes, comm=comm)
        block = self._matrix.createSubMatrix(rows, rows)
        rows.destroy()
        block.convert(BY_ENTRY)
        block.setOption(PETSc.Mat.Option.SPD, True)
        self._direct = create_ksp(block, direct_options(comm), prefix=PREFIX + "filter_")
        self._direct.setUp()
        self._right, self._left = block.createVecs()
        self._inner = [block, self._right, self._left]

    def start(self, right: PETSc.Vec, x: PETSc.Vec) -> None:
        """Change ``x`` so that ``right - A x`` vanishes where filtered; collective."""
        if self._direct is not None:
            self._matrix.mult(x, self._product)
            self._product.aypx(-1.0, right)
            self._add_filtered(1.0, x)

    def apply(self, _: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """``z = B r`` for a residual that vanishes where filtered."""
        self._multigrid.apply(r, z)
        if self._direct is not None:
            self._matrix.mult(z, self._product)
            self._add_filtered(-1.0, z)

    def destroy(self, _: PETSc.PC | None = None) -> None:
        """Free the PETSc objects; collective."""
        self._forget()
        self._end()
        if self._soft is not None:
            self._soft.destroy()
        self._unblocked.destroy()
        self._product.destroy()

    def _begin(self) -> None:
        prefix = PREFIX + "multigrid_"
        self._multigrid = PETSc.PC().create(self._matrix.getComm())
        self._multigrid.setOptionsPrefix(prefix)
        options = multigrid_options() | _CHANGES
        self._options = configure([self._multigrid], options, prefix=prefix)

    def _end(self) -> None:
        self._options.remove()
        self._multigrid.destroy()

    def _add_filtered(self, factor: float, z: PETSc.Vec) -> None:
        """``z += factor F product``."""
        assert self._direct is not None
        self._right.array_w[:] = self._product.array_r[self._filtered]
        self._direct.solve(self._right, self._left)
        z.array_w[self._filtered] += factor * self._left.array_r

    def _forget(self) -> None:
        if self._direct is not None:
            destroy_ksp(self._direct)
        for item in self._inner:
            item.destroy()
        self._inner, self._direct = [], None
