"""Solves with one tangent of the interior point method after another, direct or iterative."""

from __future__ import annotations

import abc
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any

from petsc4py import PETSc

from contact_locking.errors import NotConverged
from contact_locking.solver.linear.factorised import FILTER_LIMIT, MODERATE_CONTRAST, chosen
from contact_locking.solver.linear.gmres import OWN_PRECONDITIONER, Follow, Gmres
from contact_locking.solver.linear.ksp import (
    FROM_ANY_START,
    LINEAR_FAILURE,
    IterationListener,
    Unblocked,
    create_ksp,
    default_options,
    destroy_ksp,
    option,
)
from contact_locking.solver.linear.multigrid import CoarserSpace, FilteredMultigrid, StiffPart
from contact_locking.solver.settings import Settings

#: Gives a matrix the values of the tangent; collective.
Assemble = Callable[[PETSc.Mat], None]

# With a preconditioner of the user.  The norm is that of the equilibrium residual, which is what is
# left of an inexact solve.
_WITH_ANOTHER: dict[str, Any] = {
    "ksp_type": "cg",
    "ksp_norm_type": "unpreconditioned",
    "ksp_max_it": 2000,
    **FROM_ANY_START,
}
# PETSc's number for a matrix that is not positive definite.
_NOT_DEFINITE = 71

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


class TangentSolver(abc.ABC):
    """Solves with a tangent whose values change; all of it is collective.

    ``matrix`` is where the solver may have these values assembled.
    """

    #: The factorisation, if there is one, until this is destroyed.  Other tangents that are
    #: assembled into its matrix need no symbolic factorisation.
    direct: PETSc.KSP | None = None
    #: Whether :meth:`solve` takes forces that follow.
    solves_following: bool = False

    def __init__(self, matrix: PETSc.Mat) -> None:
        self._matrix, self._iterations = matrix, 0

    @abc.abstractmethod
    def refresh(self, assemble: Assemble, split: Callable[[], StiffPart]) -> None:
        """The tangent has new values.

        ``assemble`` gives them to the matrix if the solver needs them there, and ``split`` tells
        which are stiff.
        """

    def multiply(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """``y = A x`` for an x that is zero where displacements are prescribed."""
        self._matrix.mult(x, y)

    @abc.abstractmethod
    def solve(
        self,
        right: PETSc.Vec,
        step: PETSc.Vec,
        residual: float,
        is_rough: bool = False,
        follow: Follow | None = None,
    ) -> None:
        """Leave a residual of ``residual`` at most, starting from ``step``.

        Solves that are rough, and many, may leave more than others.  ``follow`` adds forces that
        follow the displacement.  Raises NotConverged, or PETSc's error.
        """

    @property
    def filters(self) -> bool:
        """Whether the filter or the projection takes part at present."""
        return False

    def take_iterations(self) -> int:
        """The Krylov iterations since the last call."""
        count, self._iterations = self._iterations, 0
        return count

    @abc.abstractmethod
    def destroy(self) -> None:
        """Free the PETSc objects."""


def tangent_solver(
    matrix: PETSc.Mat,
    dim: int,
    degree: int,
    settings: Settings,
    contrast: float,
    listen: Callable[[int], None],
    find_coarser: Callable[[], Sequence[tuple[PETSc.Mat, PETSc.NullSpace]]],
) -> TangentSolver:
    """The solver by the settings; with a preconditioner of the user, PETSc's KSP alone; collective.

    The arguments are those of :class:`MultigridTangents`, whose coarser spaces ``find_coarser``
    finds.  Raises InputError for a name that is not known.
    """
    name, petsc = chosen(settings.linear, dim, matrix.getSize()[0]), settings.petsc
    if name == "iterative":
        if option("pc_type", OWN_PRECONDITIONER, petsc) == OWN_PRECONDITIONER["pc_type"]:
            coarser = [CoarserSpace(*found) for found in find_coarser()]
            return MultigridTangents(matrix, dim, degree, petsc, contrast, listen, coarser)
        return KspTangents(matrix, _WITH_ANOTHER, petsc, False, listen)
    defaults = default_options(name, dim, matrix.getSize()[0], matrix.getComm())
    return KspTangents(matrix, defaults, petsc, name == "direct", listen)


class KspTangents(TangentSolver):
    """Solves with the tolerances of the options, ``overrides`` before ``defaults``.

    ``is_direct`` tells that the defaults factorise.  Otherwise ``listen`` is told the number of
    each Krylov iteration.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        defaults: Mapping[str, Any],
        overrides: Mapping[str, Any],
        is_direct: bool,
        listen: Callable[[int], None],
    ) -> None:
        super().__init__(matrix)
        self._ksp = create_ksp(matrix.getComm(), defaults, overrides)
        self.direct = self._ksp if is_direct else None
        self._listener = None if is_direct else IterationListener(self._ksp, listen)
        self._unblocked = Unblocked()

    def refresh(self, assemble: Assemble, split: Callable[[], StiffPart]) -> None:
        assemble(self._matrix)
        self._ksp.setOperators(self._unblocked.of(self._matrix))

    def solve(
        self,
        right: PETSc.Vec,
        step: PETSc.Vec,
        residual: float,
        is_rough: bool = False,
        follow: Follow | None = None,
    ) -> None:
        """Solve to the tolerances of the options."""
        self._ksp.solve(right, step)
        if self._listener is not None:
            self._listener.raise_kept()
        self._iterations += self._ksp.getIterationNumber()
        # Unlike CHOLMOD, MUMPS counts negative pivots and goes on.
        pc = self._ksp.getPC()
        by_mumps = pc.getType() == "cholesky" and pc.getFactorSolverType() == "mumps"
        if by_mumps and pc.getFactorMatrix().getMumpsInfog(12) > 0:
            raise PETSc.Error(_NOT_DEFINITE)

    def destroy(self) -> None:
        self._unblocked.destroy()
        destroy_ksp(self._ksp)


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
        self.solves_following = self._gmres.solves_following
        self._filters, self._smooths_more, self._hardest = False, False, 0
        is_moderate = contrast <= MODERATE_CONTRAST
        self._patience_of_projection = _LONGER_PATIENCE if is_moderate else _PATIENCE_OF_PROJECTION

    def refresh(self, assemble: Assemble, split: Callable[[], StiffPart]) -> None:
        """The tangent has new values; its matrix gets none where it is projected."""
        self._stiff = split()
        self._can_filter = self._multigrid.count(self._stiff.nodes) > 0
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
            self._multigrid.refresh(self._stiff)
        else:
            self._multigrid.refresh(smooths_more=self._smooths_more)

    def multiply(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._multigrid.multiply(x, y)

    def solve(
        self,
        right: PETSc.Vec,
        step: PETSc.Vec,
        residual: float,
        is_rough: bool = False,
        follow: Follow | None = None,
    ) -> None:
        """Solve by multigrid alone while the patience lasts, then with the filter.

        Solves that are rough do not count as reasons for a filter.
        """
        size = right.norm() or 1.0
        enough = min(max(residual, _ROUNDING * size), (1.0 if is_rough else _LOOSEST) * size)
        if self._can_filter and not self.filters:
            count, left = self._gmres.solve(right, step, enough, self._patience, follow)
            self._iterations += count
            if not is_rough:
                self._hardest = max(self._hardest, count)
                if not self._projects:
                    self._patience = max(self._patience - count, 0)
            if left <= enough:
                return
            self._multigrid.refresh(self._stiff)
            self._filters = True
        count, left = self._gmres.solve(right, step, enough, self._gmres.max_iterations, follow)
        self._iterations += count
        if not left <= max(enough, _FAILED * size):
            raise NotConverged(LINEAR_FAILURE)

    @property
    def filters(self) -> bool:
        return self._multigrid.filters

    def destroy(self) -> None:
        self._gmres.destroy()
        self._multigrid.destroy()
