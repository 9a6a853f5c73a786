"""Linear systems whose matrix is bordered by a few columns, by elimination of the matrix."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from petsc4py import PETSc

from contact_locking.arrays import FloatArray

# Rounding may leave this share of the corner in place of a Schur complement.
_LEAST = 1e-15


class Border:
    """``K x + B q = r``, ``B^T x + C q = s`` with few unknowns q and a symmetric C.

    With ``K Y = B``, solved once for each matrix, ``(C - B^T Y) q = s - B^T x_0`` and
    ``x = x_0 - Y q`` where ``K x_0 = r``.  The Schur complement ``C - B^T Y`` is symmetric and
    positive definite if the whole matrix is.  A column without an entry on the diagonal is left
    out: its unknown is zero.  All ranks have all of q.
    """

    def __init__(self, count: int, create: Callable[[], PETSc.Vec]) -> None:
        #: The columns of B, for the caller to fill before :meth:`refresh`.
        self.columns = [create() for _ in range(count)]
        self._answers = [create() for _ in range(count)]

    def refresh(self, corner: FloatArray, solve: Callable[[PETSc.Vec, PETSc.Vec], None]) -> None:
        """Take the columns and C; ``solve`` solves with K; collective."""
        self._diagonal = diagonal = np.diag(corner).copy()
        for column, answer in zip(self.columns, self._answers, strict=True):
            answer.set(0.0)
            if column.norm() > 0.0:
                solve(column, answer)
        products = [[b.dot(y) for y in self._answers] for b in self.columns]
        schur = corner - np.reshape(products, corner.shape)
        schur = 0.5 * (schur + schur.T)
        np.fill_diagonal(schur, np.maximum(np.diag(schur), _LEAST * diagonal))
        idle = diagonal == 0.0
        schur[idle], schur[:, idle] = 0.0, 0.0
        schur[idle, idle] = 1.0
        self._schur = schur

    def solve(self, x: PETSc.Vec, right: Sequence[float] | FloatArray) -> FloatArray:
        """Find q for ``K^-1 r`` in x, which becomes the solution, and ``right`` s; collective."""
        if not self.columns:
            return np.zeros(0)
        left = np.array(right) - [b.dot(x) for b in self.columns]
        left[self._diagonal == 0.0] = 0.0
        q = np.linalg.solve(self._schur, left)
        # Every rank takes the same step, to the last digit.
        q = x.getComm().tompi4py().bcast(q)
        for share, answer in zip(q, self._answers, strict=True):
            x.axpy(-share, answer)
        return np.asarray(q)

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        for item in (*self.columns, *self._answers):
            item.destroy()
