"""Solves with one tangent of the interior point method after another, direct or iterative."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from petsc4py import PETSc

from contact_locking.solver.linear.factorised import chosen
from contact_locking.solver.linear.gmres import (
    OWN_PRECONDITIONER,
    Assemble,
    Follow,
    MultigridTangents,
)
from contact_locking.solver.linear.ksp import (
    FROM_ANY_START,
    IterationListener,
    Unblocked,
    create_ksp,
    destroy_ksp,
    direct_options,
    iterative_options,
    user_options,
)
from contact_locking.solver.linear.multigrid import CoarserSpace, StiffPart
from contact_locking.solver.settings import Settings

# With a preconditioner of the user.  The norm is that of the equilibrium residual, which is what is
# left of an inexact solve.
_WITH_ANOTHER: dict[str, Any] = {
    **iterative_options(),
    "ksp_norm_type": "unpreconditioned",
    **FROM_ANY_START,
}
# PETSc's number for a matrix that is not positive definite.
_NOT_DEFINITE = 71


def tangent_solver(
    matrix: PETSc.Mat,
    dim: int,
    degree: int,
    settings: Settings,
    listen: Callable[[int], None],
    find_coarser: Callable[[], CoarserSpace | None],
) -> KspTangents | MultigridTangents:
    """The solver by the settings; with a preconditioner of the user, PETSc's KSP alone; collective.

    The arguments are those of :class:`MultigridTangents`, whose coarser space ``find_coarser``
    finds.
    """
    petsc, comm = settings.petsc, matrix.getComm()
    if chosen(settings.linear, dim, matrix.getSize()[0]) == "direct":
        return KspTangents(matrix, direct_options(comm), petsc, True, listen)
    if user_options(petsc).get("pc_type", OWN_PRECONDITIONER) != OWN_PRECONDITIONER:
        return KspTangents(matrix, _WITH_ANOTHER, petsc, False, listen)
    return MultigridTangents(matrix, dim, degree, petsc, listen, find_coarser())


class KspTangents:
    """Solves with the tolerances of the options, ``overrides`` before ``defaults``; collective.

    ``is_direct`` tells that the defaults factorise.  Otherwise ``listen`` is told the number of
    each Krylov iteration.
    """

    filters = solves_following = False

    def __init__(
        self,
        matrix: PETSc.Mat,
        defaults: Mapping[str, Any],
        overrides: Mapping[str, Any],
        is_direct: bool,
        listen: Callable[[int], None],
    ) -> None:
        self._matrix, self._unblocked = matrix, Unblocked()
        #: The Krylov iterations so far.
        self.iterations = 0
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
        self.iterations += self._ksp.getIterationNumber()
        # Unlike CHOLMOD, MUMPS counts negative pivots and goes on.
        pc = self._ksp.getPC()
        by_mumps = pc.getType() == "cholesky" and pc.getFactorSolverType() == "mumps"
        if by_mumps and pc.getFactorMatrix().getMumpsInfog(12) > 0:
            raise PETSc.Error(_NOT_DEFINITE)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._unblocked.destroy()
        destroy_ksp(self._ksp)
