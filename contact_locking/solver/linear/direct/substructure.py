"""One substructure: an interior that CHOLMOD eliminates, and a corner that others share."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import get_lapack_funcs

from contact_locking.arrays import FloatArray
from contact_locking.solver.linear.direct import native

Numbers = npt.NDArray[np.integer]


class Substructure:
    """``P A P^T = L L^T`` with the interior first; collective to make.

    The corner of L is kept with its rows and columns in reverse order, as an upper triangle U.
    ``order`` are the interior's numbers in the order of elimination, then those of the corner, of
    which there is one at least.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        interior: Numbers,
        corner: Numbers,
        comm: MPI.Intracomm,
    ) -> None:
        self._library, self._ffi = native.library(comm)
        starts, columns, _ = matrix.getValuesCSR()
        self.order = np.concatenate([interior, corner]).astype(np.int32)
        # CHOLMOD keeps no copy of the pattern.
        self._pattern = [self._ints(starts), self._ints(columns)]
        sizes = len(self.order), *self._pattern, len(interior)
        made = self._library.substructure_new(*sizes, self._ints(self.order))
        self.has_memory = bool(made)
        self._made = self._ffi.gc(made, self._library.substructure_free) if made else made
        self._corner = np.empty((len(corner), len(corner)), order="F")
        self._vector = np.empty(len(self.order))
        (self._lauum,) = get_lapack_funcs(("lauum",))
        self._inside = self._vector[: len(interior)]
        self._reversed = self._vector[len(interior) :][::-1]

    def factorise(self, values: FloatArray) -> bool:
        """Whether a matrix with these values is positive definite, and L exists."""
        corner = self._numbers(self._corner.reshape(-1, order="F"))
        return not self._library.substructure_factorise(self._made, self._numbers(values), corner)

    def complement(self) -> FloatArray:
        """``U U^T``, its upper triangle: the Schur complement of the interior."""
        product, _ = self._lauum(self._corner)
        return np.asarray(product)

    def forward(self, interior: FloatArray) -> FloatArray:
        """``-A_GI A_I^-1 b`` for a right-hand side b inside; to be followed by ``backward``."""
        self._vector[:] = 0.0
        self._inside[:] = interior
        self._library.substructure_forward(self._made, self._numbers(self._vector))
        return self._reversed.copy()

    def backward(self, corner: FloatArray) -> FloatArray:
        """The solution inside for the solution in the corner."""
        self._reversed[:] = corner
        self._library.substructure_backward(self._made, self._numbers(self._vector))
        return self._inside

    def _ints(self, array: npt.NDArray[Any]) -> Any:
        return self._ffi.from_buffer("int[]", np.ascontiguousarray(array, dtype=np.int32))

    def _numbers(self, array: FloatArray) -> Any:
        return self._ffi.from_buffer("double[]", array)
