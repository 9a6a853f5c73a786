"""Solves with one tangent of the interior point method after another, direct or by GMRES.

GMRES with the filtered multigrid solves for a tangent, and with forces that follow the
displacement:

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
from contextlib import ExitStack
from types import SimpleNamespace
from typing import Any

from petsc4py import PETSc

from contact_locking.problem.system import affine_part
from contact_locking.solver.ksp import (
    FILTER_LIMIT,
    FROM_ANY_START,
    IterationListener,
    LinearFailure,
    Unblocked,
    create_ksp,
    destroy_ksp,
    direct_options,
    is_direct,
    iterative_options,
    user_options,
)
from contact_locking.solver.multigrid import CoarserSpace, FilteredMultigrid, StiffPart
from contact_locking.solver.task import Counts, Task

#: Gives a matrix the values of the tangent; collective.
Assemble = Callable[[PETSc.Mat], None]
#: Adds the forces that follow a displacement to its second argument; collective.
Follow = Callable[[PETSc.Vec, PETSc.Vec], None]

#: The filtered multigrid is for PETSc a preconditioner of type python.
OWN_PRECONDITIONER = "python"
# For matrices without symmetry, too.
_FOR_ANY_MATRIX = ("gmres", "fgmres", "lgmres", "gcr")
_OPTIONS: dict[str, Any] = {
    "ksp_norm_type": "unpreconditioned",
    "ksp_max_it": 2000,
    **FROM_ANY_START,
    "pc_type": OWN_PRECONDITIONER,
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
# GMRES aims at this share of the residual asked for: its own estimate of the residual is a little
# too small.
_AIM = 0.8

# How much a linear solve aims to reduce its right-hand side at least: 3e-3 saves no tangents.
_LOOSEST = 1e-2
# A solve that leaves more of it has failed.  Rounding may keep a small right-hand side from getting
# smaller, and whatever is left counts in the equilibrium residual of the next iterate.
_FAILED = 0.2
# No linear residual gets smaller than this.
_ROUNDING = 1e-12
# So many iterations with one tangent, by dimension, may be taken instead of the factorisation of
# a filter or a projection: some ten in 3D, two in 2D, for each of the six solves that it serves.
_PATIENCE = {2: 16, 3: 60}


class MultigridTangents:
    """GMRES begins with multigrid alone, which is enough as long as no cell is much stiffer.

    Where a tangent takes more iterations than the filter would cost, it is filtered from there on,
    and so are all that follow.  All of it is collective.

    The matrix is stored in blocks and has its near-nullspace.  ``dim`` and ``degree`` are those of
    the elements, ``listen`` is told the number of each Krylov iteration, which ``counts`` adds up,
    ``coarser`` is the coarser space of multigrid, if any, and ``options`` are those of the user,
    which override those that this has, the type of the solver included.
    """

    direct = None

    def __init__(
        self,
        matrix: PETSc.Mat,
        dim: int,
        degree: int,
        options: Mapping[str, Any],
        listen: Callable[[int], None],
        counts: Counts,
        coarser: CoarserSpace | None = None,
    ) -> None:
        self._matrix, self._dim, comm = matrix, dim, matrix.getComm()
        self.counts = counts
        self._has_filtered = False
        self._follow: Follow | None = None
        kind = user_options(options).get("ksp_type")
        self._may_choose = kind is None
        # PETSc's own choice of a type is GMRES.
        defaults = _OPTIONS | (_OF_GMRES if kind in (None, _GMRES, _FLEXIBLE) else {})
        with ExitStack() as made:
            # PETSc raises for values that it does not know, and nothing may stay in its database.
            self._multigrid = FilteredMultigrid(matrix, FILTER_LIMIT[dim, degree], coarser, options)
            made.callback(self._multigrid.destroy)
            self._ksp = create_ksp(comm, defaults, options)
            made.pop_all()
        context = SimpleNamespace(mult=self._mult, apply=self._apply)
        self._operator = PETSc.Mat().createPython(matrix.getSizes(), context, comm=comm)
        self._operator.setUp()
        self._ksp.setErrorIfNotConverged(False)
        self._ksp.setInitialGuessNonzero(True)
        self._ksp.setOperators(self._operator)
        self._ksp.getPC().setPythonContext(context)
        self._listener = IterationListener(self._ksp, listen)
        self._left = matrix.createVecLeft()
        self._most: int = self._ksp.getTolerances()[3]
        #: Whether forces may follow: not with a user's solver for symmetric matrices.
        self.solves_following: bool = self._ksp.getType() in _FOR_ANY_MATRIX

    @property
    def filters(self) -> bool:
        """Whether the filter or the projection takes part at present."""
        return self._multigrid.helper is not None

    def refresh(self, assemble: Assemble, split: Callable[[], StiffPart]) -> None:
        """The tangent has new values.

        ``assemble`` gives them to a matrix, which is not done where it is projected, and ``split``
        tells which are stiff.
        """
        self._stiff = split()
        projects = self._multigrid.must_project(self._stiff)
        self._can_filter = self._multigrid.count(self._stiff.nodes) > 0
        self._patience = _PATIENCE[self._dim]
        filters = self._has_filtered and self._can_filter
        if not (filters and projects):
            assemble(self._matrix)
        self._multigrid.refresh(self._stiff if filters else None)

    def multiply(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """``y = K x`` for an x that is zero where displacements are prescribed."""
        self._multigrid.multiply(x, y)

    def solve(
        self,
        right: PETSc.Vec,
        step: PETSc.Vec,
        residual: float,
        is_rough: bool = False,
        follow: Follow | None = None,
    ) -> None:
        """Leave a residual of ``residual`` at most, starting from ``step``.

        By multigrid alone while the patience lasts, then with the filter.  Solves that are rough,
        and many, may leave more than others and are no reason for a filter.  ``follow`` adds forces
        that follow the displacement.  Raises LinearFailure, or PETSc's error.
        """
        self._follow = follow
        size = right.norm() or 1.0
        enough = min(max(residual, _ROUNDING * size), (1.0 if is_rough else _LOOSEST) * size)
        if self._can_filter and not self.filters:
            before = self.counts.linear
            left = self._improve(right, step, enough, min(self._patience, self._most))
            if not is_rough:
                self._patience = max(self._patience - (self.counts.linear - before), 0)
            if left <= enough:
                return
            self._multigrid.refresh(self._stiff)
            self._has_filtered = True
        left = self._improve(right, step, enough, self._most)
        if not left <= max(enough, _FAILED * size):
            raise LinearFailure

    def _mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """``y = (K + F) x``; called by PETSc."""
        self._multigrid.multiply(x, y)
        if self._follow is not None:
            self._follow(x, y)

    def _apply(self, _: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """``z = B r``; called by PETSc."""
        self._multigrid.apply(r, z, vanishes=self._follow is None)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        destroy_ksp(self._ksp)
        self._operator.destroy()
        self._left.destroy()
        self._multigrid.destroy()

    def _improve(self, right: PETSc.Vec, x: PETSc.Vec, residual: float, most: int) -> float:
        """Improve ``x`` to a residual, or until ``most`` iterations are taken.

        Returns the residual that is left but for rounding.
        """
        # Flexible GMRES for what is expensive to apply; PETSc frees the memory of the other.
        kind = _FLEXIBLE if self.filters else _GMRES
        if self._may_choose and self._ksp.getType() != kind:
            self._ksp.setType(kind)
            self._ksp.setFromOptions()
        count, size = 0, right.norm()
        for _ in range(_CYCLES):
            if self._follow is None:
                self._multigrid.start(right, x)
            left = self._residual(right, x)
            if left <= residual or count >= most:
                return left
            is_first = left > size and count == 0
            longest = _FIRST if is_first else most - count
            self._ksp.setTolerances(rtol=0.0, atol=_AIM * residual, max_it=longest)
            self._ksp.solve(right, x)
            self._listener.raise_kept()
            count += self._ksp.getIterationNumber()
            self.counts.linear += self._ksp.getIterationNumber()
        # Rounding keeps what GMRES has achieved from being seen.
        ends_small = self._ksp.getConvergedReason() > 0
        return self._ksp.getResidualNorm() if ends_small else self._residual(right, x)

    def _residual(self, right: PETSc.Vec, x: PETSc.Vec) -> float:
        self._operator.mult(x, self._left)
        self._left.aypx(-1.0, right)
        return float(self._left.norm())


# With a preconditioner of the user.  The norm is that of the equilibrium residual, which is what is
# left of an inexact solve.
_WITH_ANOTHER: dict[str, Any] = {
    **iterative_options(),
    "ksp_norm_type": "unpreconditioned",
    **FROM_ANY_START,
}
# PETSc's number for a matrix that is not positive definite.
_NOT_DEFINITE = 71


def tangent_solver(matrix: PETSc.Mat, task: Task) -> KspTangents | MultigridTangents:
    """The solver by the settings; with a preconditioner of the user, PETSc's KSP alone; collective.

    ``matrix`` is that of :class:`MultigridTangents`.
    """
    system, petsc = task.system, task.settings.petsc
    dim, degree = system.dim, system.data.element.degree
    common = petsc, task.monitor.linear, task.counts
    if is_direct(task.settings.linear, dim, matrix.getSize()[0]):
        return KspTangents(matrix, direct_options(matrix.getComm()), True, *common)
    if user_options(petsc).get("pc_type", OWN_PRECONDITIONER) != OWN_PRECONDITIONER:
        return KspTangents(matrix, _WITH_ANOTHER, False, *common)
    affine = affine_part(system.u.function_space, system.constraints) if degree > 1 else None
    coarser = None if affine is None else CoarserSpace(*affine)
    return MultigridTangents(matrix, dim, degree, *common, coarser)


class KspTangents:
    """Solves with the tolerances of the options, ``overrides`` before ``defaults``; collective.

    ``is_direct`` tells that the defaults factorise.  Otherwise ``listen`` is told the number of
    each Krylov iteration; ``counts`` adds them up.
    """

    filters = solves_following = False

    def __init__(
        self,
        matrix: PETSc.Mat,
        defaults: Mapping[str, Any],
        is_direct: bool,
        overrides: Mapping[str, Any],
        listen: Callable[[int], None],
        counts: Counts,
    ) -> None:
        self._matrix, self._unblocked, self.counts = matrix, Unblocked(), counts
        self._ksp = create_ksp(matrix.getComm(), defaults, overrides)
        #: The factorisation, if there is one, until this is destroyed.  Other tangents that are
        #: assembled into its matrix need no symbolic factorisation.
        self.direct = self._ksp if is_direct else None
        self._listener = None if is_direct else IterationListener(self._ksp, listen)

    def refresh(self, assemble: Assemble, split: Callable[[], StiffPart]) -> None:
        """Assemble the new values of the tangent."""
        assemble(self._matrix)
        self._ksp.setOperators(self._unblocked.of(self._matrix))

    def multiply(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """``y = K x``."""
        self._matrix.mult(x, y)

    def solve(
        self,
        right: PETSc.Vec,
        step: PETSc.Vec,
        residual: float,
        is_rough: bool = False,
        follow: Follow | None = None,
    ) -> None:
        """Solve to the tolerances of the options; raises PETSc's error."""
        self._ksp.solve(right, step)
        if self._listener is not None:
            self._listener.raise_kept()
        self.counts.linear += self._ksp.getIterationNumber()
        if self._has_negative_pivots():
            raise PETSc.Error(_NOT_DEFINITE)

    def _has_negative_pivots(self) -> bool:
        """Whether MUMPS, which goes on where CHOLMOD stops, has met negative pivots."""
        # In the frame of an exception, `pc` would outlive the solver on one rank alone.
        pc = self._ksp.getPC()
        by_mumps = pc.getType() == "cholesky" and pc.getFactorSolverType() == "mumps"
        return by_mumps and pc.getFactorMatrix().getMumpsInfog(12) > 0

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._unblocked.destroy()
        destroy_ksp(self._ksp)
