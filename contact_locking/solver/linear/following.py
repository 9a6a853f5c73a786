"""Solves with a symmetric matrix and with forces that follow the displacement without symmetry.

    (K + F) x = r

The friction bound follows the pressure, and the pressure follows the displacement: the forces
``F x`` that belong to it are few, on a part of the surface, and far smaller than ``K x`` unless
friction is large.  GMRES (doi:10.1137/0907058) with the preconditioner of ``K`` therefore takes
hardly more iterations than CG takes for ``K`` alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from petsc4py import PETSc

from contact_locking.solver.linear.filtered_multigrid import FilteredMultigrid
from contact_locking.solver.linear.ksp import (
    FROM_ANY_START,
    IterationListener,
    create_ksp,
    destroy_ksp,
)
from contact_locking.solver.linear.options import PREFIX

#: Adds ``F x`` to its second argument; collective.
Follow = Callable[[PETSc.Vec, PETSc.Vec], None]

# The preconditioner stands on the right, so that GMRES makes the residual itself small.
_OPTIONS: dict[str, Any] = {
    "ksp_type": "gmres",
    "ksp_gmres_restart": 100,
    "ksp_pc_side": "right",
    "ksp_norm_type": "unpreconditioned",
    **FROM_ANY_START,
    "pc_type": "python",
}
# The first iteration removes the residual of stiff cells, by far the largest part.  GMRES then
# begins anew: rounding in its residual is relative to the residual with which it began.
_FIRST = 1
# GMRES runs so often at most, as rounding may leave more than the residual asked for.
_CYCLES = 4
# GMRES aims at this share of the residual asked for: its own estimate of the residual is a little
# too small.
_AIM = 0.8


class _Sum:
    """The context of the matrix ``K + F``."""

    follow: Follow

    def __init__(self, matrix: PETSc.Mat) -> None:
        self._matrix = matrix

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """``y = (K + F) x``."""
        self._matrix.mult(x, y)
        self.follow(x, y)


class _Preconditioner:
    """The context of the preconditioner of ``K``."""

    def __init__(self, multigrid: FilteredMultigrid) -> None:
        self._multigrid = multigrid

    def apply(self, _: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """``z = B r``."""
        self._multigrid.apply_to_any(r, z)


class FollowingSolver:
    """GMRES for ``(K + F) x = r`` with the preconditioner of ``K``; all of it is collective.

    ``listen`` is told the number of each iteration.
    """

    def __init__(
        self, matrix: PETSc.Mat, multigrid: FilteredMultigrid, listen: Callable[[int], None]
    ) -> None:
        comm, self._context = matrix.getComm(), _Sum(matrix)
        self._sum = PETSc.Mat().createPython(matrix.getSizes(), self._context, comm=comm)
        self._sum.setUp()
        self._ksp = create_ksp(comm, _OPTIONS, prefix=PREFIX + "following_")
        self._ksp.setErrorIfNotConverged(False)
        self._ksp.setInitialGuessNonzero(True)
        self._ksp.setOperators(self._sum)
        self._ksp.getPC().setPythonContext(_Preconditioner(multigrid))
        self._listener = IterationListener(self._ksp, listen)
        self._left = matrix.createVecLeft()

    def solve(
        self, follow: Follow, right: PETSc.Vec, x: PETSc.Vec, residual: float, most: int
    ) -> tuple[int, float]:
        """Improve ``x`` to a residual, or until ``most`` iterations are taken.

        Returns the iterations, and the residual that is left.
        """
        self._context.follow, count = follow, 0
        left = self._residual(right, x)
        for cycle in range(_CYCLES):
            if left <= residual or count >= most:
                break
            longest = _FIRST if cycle == 0 else most - count
            self._ksp.setTolerances(rtol=0.0, atol=_AIM * residual, max_it=longest)
            self._ksp.solve(right, x)
            self._listener.raise_kept()
            count += self._ksp.getIterationNumber()
            left = self._residual(right, x)
        return count, left

    def destroy(self) -> None:
        """Free the PETSc objects."""
        destroy_ksp(self._ksp)
        self._sum.destroy()
        self._left.destroy()

    def _residual(self, right: PETSc.Vec, x: PETSc.Vec) -> float:
        self._sum.mult(x, self._left)
        self._left.aypx(-1.0, right)
        return float(self._left.norm())
