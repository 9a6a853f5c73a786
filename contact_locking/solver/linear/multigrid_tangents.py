"""Linear solves with one tangent after another by GMRES and multigrid, as cheap as can be."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any

from petsc4py import PETSc

from contact_locking.errors import NotConverged
from contact_locking.solver.linear.factorised import FILTER_LIMIT, MODERATE_CONTRAST
from contact_locking.solver.linear.filtered_multigrid import FilteredMultigrid, StiffPart
from contact_locking.solver.linear.gmres import Gmres
from contact_locking.solver.linear.ksp import LINEAR_FAILURE
from contact_locking.solver.linear.multigrid import CoarserSpace
from contact_locking.solver.linear.tangent_solver import Assemble, Follow, TangentSolver

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
# iterations.  Up to a moderate contrast multigrid alone is therefore allowed more of them: the
# iterations of all solves with a tangent, some two and a half times as many, then take as long as
# with the projection.
_PATIENCE_OF_PROJECTION = 50
_LONGER_PATIENCE = 300
# From one tangent to the next the iterations of the hardest solve grow by about half.  If they
# exceed this share of the patience, the next tangent would end it.  So the next tangent gets more
# steps of the smoother or, if it has them already, the projection from its first solve on.
_NEARLY_IMPATIENT = 0.6


class MultigridTangents(TangentSolver):
    """GMRES begins with multigrid alone, which is enough as long as no cell is much stiffer.

    Where a tangent takes more iterations than the filter would cost, it is filtered from there on,
    and so are all that follow.

    The matrix is stored in blocks and has its near-nullspace.  ``dim`` and ``degree`` are those of
    the elements, ``contrast`` is how many times stiffer than the material a cell can become,
    ``listen`` is told the number of each Krylov iteration, ``coarser`` are the coarser spaces of
    multigrid, and ``options`` those of the user.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        dim: int,
        degree: int,
        options: Mapping[str, Any],
        contrast: float,
        listen: Callable[[int], None],
        coarser: Sequence[CoarserSpace] = (),
    ) -> None:
        super().__init__(matrix)
        self._dim = dim
        with ExitStack() as made:
            # PETSc raises for values that it does not know, and nothing may stay in its database.
            limit = FILTER_LIMIT[dim, degree]
            self._multigrid = FilteredMultigrid(matrix, limit, coarser, options)
            made.callback(self._multigrid.destroy)
            self._gmres = Gmres(matrix, self._multigrid, options, listen)
            made.pop_all()
        self._filters, self._smooths_more, self._hardest = False, False, 0
        is_moderate = contrast <= MODERATE_CONTRAST
        self._patience_of_projection = _LONGER_PATIENCE if is_moderate else _PATIENCE_OF_PROJECTION

    def refresh(self, assemble: Assemble, split: Callable[[], StiffPart]) -> None:
        """The tangent has new values; its matrix gets none where it is projected."""
        self._stiff = split()
        self._can_filter = self._multigrid.can_filter(self._stiff)
        self._projects = self._multigrid.must_project(self._stiff)
        patience = self._patience_of_projection if self._projects else _PATIENCE[self._dim]
        self._patience = min(patience, self._gmres.max_iterations)
        is_nearly_impatient = self._hardest > _NEARLY_IMPATIENT * self._patience
        if self._projects and not self._filters and is_nearly_impatient:
            self._filters = self._smooths_more
            self._smooths_more = True
        self._hardest = 0
        filters = self._filters and self._can_filter
        if not (filters and self._projects):
            assemble(self._matrix)
        if filters:
            self._filter()
        else:
            self._multigrid.refresh()
            if self._smooths_more:
                self._multigrid.smooth_more()

    def multiply(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._multigrid.multiply(x, y)

    def solve(
        self, right: PETSc.Vec, step: PETSc.Vec, residual: float, is_rough: bool = False
    ) -> None:
        """Leave a residual of ``residual`` at most, starting from ``step``.

        Solves that are rough do not count as reasons for a filter.
        """
        loosest = 1.0 if is_rough else _LOOSEST

        def attempt(enough: float, most: int) -> tuple[int, float]:
            return self._gmres.solve(right, step, enough, most)

        self._improve(attempt, right, residual, loosest, is_rough)

    @property
    def filters(self) -> bool:
        return self._multigrid.filters

    @property
    def solves_following(self) -> bool:
        """Whether :meth:`solve_following` is there: if the Krylov method needs no symmetry."""
        return self._gmres.solves_following

    def solve_following(
        self, follow: Follow, right: PETSc.Vec, step: PETSc.Vec, residual: float
    ) -> None:

        def attempt(enough: float, most: int) -> tuple[int, float]:
            return self._gmres.solve_following(follow, right, step, enough, most)

        self._improve(attempt, right, residual, _LOOSEST)

    def destroy(self) -> None:
        self._gmres.destroy()
        self._multigrid.destroy()

    def _filter(self) -> None:
        self._multigrid.refresh(self._stiff)
        self._filters = True

    def _improve(
        self,
        attempt: Callable[[float, int], tuple[int, float]],
        right: PETSc.Vec,
        residual: float,
        loosest: float,
        is_rough: bool = False,
    ) -> None:
        """Attempt a solve by multigrid alone while the patience lasts, then with the filter.

        ``attempt`` takes the residual asked for and the most iterations; it returns the iterations
        that it took, and the residual that is left.  ``loosest`` is the most that may be left of
        ``right``.
        """
        size = right.norm() or 1.0
        enough = min(max(residual, _ROUNDING * size), loosest * size)
        if self._can_filter and not self._multigrid.filters:
            count, left = attempt(enough, self._patience)
            self._iterations += count
            if not is_rough:
                self._hardest = max(self._hardest, count)
            if not (is_rough or self._projects):
                self._patience = max(self._patience - count, 0)
            if left <= enough:
                return
            self._filter()
        count, left = attempt(enough, self._gmres.max_iterations)
        self._iterations += count
        if not left <= max(enough, _FAILED * size):
            raise NotConverged(LINEAR_FAILURE)
