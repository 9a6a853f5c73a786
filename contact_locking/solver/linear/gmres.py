"""GMRES with the filtered multigrid: for a tangent, and with forces that follow the displacement.

    K x = r    and    (K + F) x = r

The friction bound follows the pressure, and the pressure follows the displacement: the forces
``F x`` that belong to it are few, on a part of the surface, and far smaller than ``K x`` unless
friction is large.  GMRES (doi:10.1137/0907058) with the preconditioner of ``K`` therefore takes
hardly more iterations than for ``K`` alone.

``K`` is symmetric, and CG would do for it.  But a linear solve ends where the residual is small,
GMRES makes the residual itself as small as can be, and CG the energy of the error: where cells are
stiff along single strains, CG leaves large residuals long after the displacement is good.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from petsc4py import PETSc

from contact_locking.solver.linear.ksp import (
    FROM_ANY_START,
    IterationListener,
    create_ksp,
    destroy_ksp,
    option,
)
from contact_locking.solver.linear.multigrid import FilteredMultigrid

#: Adds the forces that follow a displacement to its second argument; collective.
Follow = Callable[[PETSc.Vec, PETSc.Vec], None]
#: The filtered multigrid, for PETSc a preconditioner of type python.
OWN_PRECONDITIONER: dict[str, Any] = {"pc_type": "python"}
# For matrices without symmetry, too.
_FOR_ANY_MATRIX = ("gmres", "fgmres", "lgmres", "gcr")
_OPTIONS: dict[str, Any] = {
    "ksp_norm_type": "unpreconditioned",
    "ksp_max_it": 2000,
    **FROM_ANY_START,
    **OWN_PRECONDITIONER,
}
# GMRES keeps a vector of each iteration, and at its end applies the preconditioner once more.
# Flexible GMRES keeps the preconditioned vectors, too, and needs no further application.  With a
# filter or a projection, whose iterations are few and expensive, that saves time.  Multigrid alone
# takes many cheap iterations, for which the memory would be the higher price.
_GMRES, _FLEXIBLE = PETSc.KSP.Type.GMRES, PETSc.KSP.Type.FGMRES
# The preconditioner stands on the right, so that GMRES makes the residual itself small.  After so
# many iterations, which hardly any solve takes, it begins anew.
_OF_GMRES: dict[str, Any] = {"ksp_pc_side": "right", "ksp_gmres_restart": 150}
# Where the start has a larger residual than none, its first iteration removes the residual of stiff
# cells, by far the largest part.  GMRES then begins anew: rounding in its residual is relative to
# the residual with which it began.
_FIRST = 1
# GMRES runs so often at most, as rounding may leave more than the residual asked for.
_CYCLES = 4
# With a filter it runs so long at most: rounding leaves a residual where it is filtered, which
# stops GMRES until it is filtered again.
_LONGEST_FILTERED = 40
# GMRES aims at this share of the residual asked for: its own estimate of the residual is a little
# too small.
_AIM = 0.8


class Contexts:
    """What PETSc calls: the product with ``K + F``, and the preconditioner ``B`` of ``K``.

    Without ``follow``, ``F`` is zero.
    """

    def __init__(self, multigrid: FilteredMultigrid) -> None:
        self._multigrid = multigrid
        self.follow: Follow | None = None

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """``y = (K + F) x``."""
        self._multigrid.multiply(x, y)
        if self.follow is not None:
            self.follow(x, y)

    def apply(self, _: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """``z = B r``."""
        if self.follow is None:
            self._multigrid.apply(r, z)
        else:
            self._multigrid.apply_to_any(r, z)


class Gmres:
    """Solves with a matrix and its filtered multigrid; all of it is collective.

    ``options`` of the user override those that this has, the type of the solver included, and
    ``listen`` is told the number of each iteration.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        multigrid: FilteredMultigrid,
        options: Mapping[str, Any],
        listen: Callable[[int], None],
    ) -> None:
        comm, self._multigrid = matrix.getComm(), multigrid
        self._contexts = Contexts(multigrid)
        self._operator = PETSc.Mat().createPython(matrix.getSizes(), self._contexts, comm=comm)
        self._operator.setUp()
        wanted = option("ksp_type", {}, options)
        self._may_choose = wanted is None
        is_gmres = wanted in (None, _GMRES, _FLEXIBLE)
        # PETSc's own choice of a type is GMRES.
        self._ksp = create_ksp(comm, _OPTIONS | (_OF_GMRES if is_gmres else {}), options)
        self._ksp.setErrorIfNotConverged(False)
        self._ksp.setInitialGuessNonzero(True)
        self._ksp.setOperators(self._operator)
        self._ksp.getPC().setPythonContext(self._contexts)
        self._listener = IterationListener(self._ksp, listen)
        self._left = matrix.createVecLeft()
        #: The most iterations of a solve.
        self.max_iterations: int = self._ksp.getTolerances()[3]
        #: Whether forces may follow: not with a user's solver for symmetric matrices.
        self.solves_following: bool = self._ksp.getType() in _FOR_ANY_MATRIX

    def solve(
        self,
        right: PETSc.Vec,
        x: PETSc.Vec,
        residual: float,
        most: int,
        follow: Follow | None = None,
    ) -> tuple[int, float]:
        """Improve ``x`` to a residual, or until ``most`` iterations are taken.

        ``follow`` adds forces that follow the displacement.  Returns the iterations, and the
        residual that is left but for rounding.
        """
        self._contexts.follow = follow
        # Flexible GMRES for what is expensive to apply; PETSc frees the memory of the other.
        kind = _FLEXIBLE if self._multigrid.filters else _GMRES
        if self._may_choose and self._ksp.getType() != kind:
            self._ksp.setType(kind)
            self._ksp.setFromOptions()
        count, size = 0, right.norm()
        for _ in range(_CYCLES):
            if follow is None:
                self._multigrid.start(right, x)
            left = self._residual(right, x)
            if left <= residual or count >= most:
                break
            longest = most - count
            if self._multigrid.filters_exactly:
                longest = min(longest, _LONGEST_FILTERED)
            if left > size and count == 0:
                longest = min(longest, _FIRST)
            self._ksp.setTolerances(rtol=0.0, atol=_AIM * residual, max_it=longest)
            self._ksp.solve(right, x)
            self._listener.raise_kept()
            count += self._ksp.getIterationNumber()
        else:
            # Rounding keeps what GMRES has achieved from being seen.
            ends_small = self._ksp.getConvergedReason() > 0
            left = self._ksp.getResidualNorm() if ends_small else self._residual(right, x)
        return count, left

    def destroy(self) -> None:
        """Free the PETSc objects."""
        destroy_ksp(self._ksp)
        self._operator.destroy()
        self._left.destroy()

    def _residual(self, right: PETSc.Vec, x: PETSc.Vec) -> float:
        self._operator.mult(x, self._left)
        self._left.aypx(-1.0, right)
        return float(self._left.norm())
