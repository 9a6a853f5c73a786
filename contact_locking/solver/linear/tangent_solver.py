"""Linear solves with one tangent after another: by factorisation, or by CG as cheap as can be."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from petsc4py import PETSc

from contact_locking.costs.factorised import FILTER_LIMIT, MODERATE_CONTRAST, chosen
from contact_locking.errors import NotConverged
from contact_locking.solver.linear.filtered_multigrid import FilteredMultigrid, StiffPart
from contact_locking.solver.linear.following import Follow, FollowingSolver
from contact_locking.solver.linear.ksp import (
    FROM_ANY_START,
    LINEAR_FAILURE,
    IterationListener,
    create_ksp,
    default_options,
    destroy_ksp,
    preconditioner,
)
from contact_locking.solver.linear.multigrid import CoarserSpace
from contact_locking.solver.linear.storage import Unblocked
from contact_locking.solver.settings import Settings

# CG with the filtered multigrid.  The norm is that of the equilibrium residual, which is what is
# left of an inexact solve.
_ITERATIVE: dict[str, Any] = {
    "ksp_type": "cg",
    "ksp_norm_type": "unpreconditioned",
    "ksp_max_it": 2000,
    **FROM_ANY_START,
    "pc_type": "python",
}
# How much a linear solve aims to reduce its right-hand side at least: 3e-3 saves no tangents.
_LOOSEST = 1e-2
# A solve that leaves more of it has failed.  Rounding may keep a small right-hand side from getting
# smaller, and whatever is left counts in the equilibrium residual of the next iterate.
_FAILED = 0.2
# No linear residual gets smaller than this.
_ROUNDING = 1e-12
# So many iterations with one tangent, by dimension, may be taken instead of the filter's
# factorisation: some ten in 3D, and two in 2D, for each of the six solves that it serves.
_PATIENCE = {2: 16, 3: 60}
# So many iterations one solve may take by multigrid alone where the projection can take over.  With
# the projection an iteration takes two to four times as long, and the set-up as long as a hundred
# iterations.  Up to a moderate contrast multigrid alone is therefore allowed more of them.
_PATIENCE_OF_PROJECTION = 50
_LONGER_PATIENCE = 150
# Rounding leaves a residual where it is filtered, the more the stiffer cells are, and CG breaks
# down on it: it is filtered again, so often at most.
_RESTARTS = 3
_BREAKDOWNS = (
    PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_PC,
    PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT,
    PETSc.KSP.ConvergedReason.DIVERGED_BREAKDOWN,
)


class TangentSolver:
    """Solves with a matrix whose values change.

    CG begins with multigrid alone, which is enough as long as no cell is much stiffer than others.
    Where a tangent takes more iterations than the filter would cost, it is filtered from there on,
    and so are all that follow.  Options of the user may replace all of this.

    The matrix is stored in blocks and has its near-nullspace.  ``contrast`` is how many times
    stiffer than the material a cell can become.  ``listen`` is told the number of each Krylov
    iteration, and ``find_coarser`` is asked for the coarser spaces of multigrid.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        dim: int,
        settings: Settings,
        contrast: float,
        listen: Callable[[int], None],
        find_coarser: Callable[[], Sequence[CoarserSpace]] = tuple,
    ) -> None:
        self._matrix, self._dim = matrix, dim
        comm, size = matrix.getComm(), matrix.getSize()[0]
        name = chosen(settings.linear, dim, size)
        defaults = _ITERATIVE if name == "iterative" else default_options(name, dim, size, comm)
        self._ksp = create_ksp(comm, defaults, settings.petsc)
        self._factorises = name == "direct"
        self._listeners = [] if self._factorises else [IterationListener(self._ksp, listen)]
        self._iterations = 0
        self._unblocked = Unblocked()
        self._multigrid: FilteredMultigrid | None = None
        self._following: FollowingSolver | None = None
        # Its own multigrid, if the user has not replaced it, can do with blocks.
        is_replaced = preconditioner(defaults, settings.petsc) != PETSc.PC.Type.PYTHON
        if not (self._factorises or is_replaced):
            self._multigrid = FilteredMultigrid(matrix, FILTER_LIMIT[dim], find_coarser())
            self._ksp.getPC().setPythonContext(self._multigrid)
            self._ksp.setErrorIfNotConverged(False)
            self._ksp.setInitialGuessNonzero(True)
            self._max_iterations = self._ksp.getTolerances()[3]
            self._following = FollowingSolver(matrix, self._multigrid, listen)
        self._filters = False
        is_moderate = contrast <= MODERATE_CONTRAST
        self._patience_of_projection = _LONGER_PATIENCE if is_moderate else _PATIENCE_OF_PROJECTION

    def refresh(self, split: Callable[[], StiffPart]) -> None:
        """The matrix has new values, ``split`` tells which are stiff; collective."""
        if self._multigrid is None:
            self._ksp.setOperators(self._unblocked.of(self._matrix))
            return
        self._ksp.setOperators(self._matrix)
        self._stiff = split()
        self._can_filter = self._multigrid.can_filter(self._stiff)
        self._projects = self._multigrid.must_project(self._stiff)
        patience = self._patience_of_projection if self._projects else _PATIENCE[self._dim]
        self._patience = min(patience, self._max_iterations)
        if self._filters and self._can_filter:
            self._filter(self._multigrid)
        else:
            self._multigrid.refresh()

    def solve(
        self, right: PETSc.Vec, step: PETSc.Vec, residual: float, is_rough: bool = False
    ) -> None:
        """Leave a residual of ``residual`` at most; collective.

        CG starts from ``step``.  Solves that are rough, and many, may leave more than others, and
        do not count as reasons for a filter.  Raises NotConverged, or PETSc's error.
        """
        if self._multigrid is None:
            self._solve(right, step)
            return
        multigrid, size = self._multigrid, right.norm() or 1.0
        rtol = max(residual / size, _ROUNDING)
        if not is_rough:
            rtol = min(_LOOSEST, rtol)
        self._improve(
            multigrid, lambda most: self._by_cg(multigrid, right, step, rtol, most), is_rough
        )
        is_done = self._ksp.getConvergedReason() > 0
        if not (is_done or self._ksp.getResidualNorm() <= _FAILED * size):
            raise NotConverged(LINEAR_FAILURE)

    @property
    def filters(self) -> bool:
        """Whether the filter or the projection takes part at present."""
        return self._multigrid is not None and self._multigrid.filters

    @property
    def solves_following(self) -> bool:
        """Whether :meth:`solve_following` is there: with the multigrid that is its own."""
        return self._following is not None

    def solve_following(
        self, follow: Follow, right: PETSc.Vec, step: PETSc.Vec, residual: float
    ) -> None:
        """Solve with forces that follow the displacement beside the matrix; collective.

        As :meth:`solve`, but by GMRES, and only where :attr:`solves_following`.  Raises
        NotConverged, or PETSc's error.
        """
        multigrid, following = self._multigrid, self._following
        assert multigrid is not None and following is not None
        size = right.norm() or 1.0
        enough = min(max(residual, _ROUNDING * size), _LOOSEST * size)
        left = math.inf

        def by_gmres(most: int) -> tuple[int, bool]:
            nonlocal left
            count, left = following.solve(follow, right, step, enough, most)
            self._iterations += count
            return count, left <= enough

        self._improve(multigrid, by_gmres)
        if not left <= _FAILED * size:
            raise NotConverged(LINEAR_FAILURE)

    @property
    def direct(self) -> PETSc.KSP | None:
        """What factorises, if anything, until this is destroyed.

        Other tangents that are assembled into its matrix need no symbolic factorisation.
        """
        return self._ksp if self._factorises else None

    def take_iterations(self) -> int:
        """The Krylov iterations since the last call."""
        count, self._iterations = self._iterations, 0
        return count

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        if self._following is not None:
            self._following.destroy()
        if self._multigrid is not None:
            self._multigrid.destroy()
        self._unblocked.destroy()
        destroy_ksp(self._ksp)

    def _filter(self, multigrid: FilteredMultigrid) -> None:
        multigrid.refresh(self._stiff)
        self._filters = True

    def _improve(
        self,
        multigrid: FilteredMultigrid,
        attempt: Callable[[int], tuple[int, bool]],
        is_rough: bool = False,
    ) -> None:
        """Attempt a solve by multigrid alone while the patience lasts, then with the filter.

        ``attempt`` takes the most iterations; it returns those that it took, and whether it is
        done.  Collective.
        """
        if self._can_filter and not multigrid.filters:
            count, is_done = attempt(self._patience)
            if not (is_rough or self._projects):
                self._patience = max(self._patience - count, 0)
            if is_done:
                return
            self._filter(multigrid)
        attempt(self._max_iterations)

    def _by_cg(
        self,
        multigrid: FilteredMultigrid,
        right: PETSc.Vec,
        step: PETSc.Vec,
        rtol: float,
        most: int,
    ) -> tuple[int, bool]:
        """The iterations of CG, and whether they suffice; collective."""
        count, reason = 0, 0
        for _ in range(1 + _RESTARTS):
            multigrid.start(right, step)
            self._ksp.setTolerances(rtol=rtol, max_it=most)
            count += self._solve(right, step)
            reason = self._ksp.getConvergedReason()
            if not multigrid.filters or reason not in _BREAKDOWNS:
                break
        return count, reason > 0

    def _solve(self, right: PETSc.Vec, step: PETSc.Vec) -> int:
        self._ksp.solve(right, step)
        for listener in self._listeners:
            listener.raise_kept()
        count = self._ksp.getIterationNumber()
        self._iterations += count
        return count
