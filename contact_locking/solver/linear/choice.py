"""Which solver a tangent of the interior point method gets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from petsc4py import PETSc

from contact_locking.solver.linear.factorised import chosen
from contact_locking.solver.linear.gmres import OWN_PRECONDITIONER
from contact_locking.solver.linear.ksp import FROM_ANY_START, default_options, option
from contact_locking.solver.linear.multigrid import CoarserSpace
from contact_locking.solver.linear.multigrid_tangents import MultigridTangents
from contact_locking.solver.linear.tangent_solver import KspTangents, TangentSolver
from contact_locking.solver.task import Settings

# With a preconditioner of the user.  The norm is that of the equilibrium residual, which is what is
# left of an inexact solve.
_WITH_ANOTHER: dict[str, Any] = {
    "ksp_type": "cg",
    "ksp_norm_type": "unpreconditioned",
    "ksp_max_it": 2000,
    **FROM_ANY_START,
}


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
    name, is_direct = chosen(settings.linear, dim, matrix.getSize()[0]), False
    if name == "iterative":
        own = OWN_PRECONDITIONER["pc_type"]
        if option("pc_type", OWN_PRECONDITIONER, settings.petsc) == own:
            coarser = [CoarserSpace(*found) for found in find_coarser()]
            return MultigridTangents(matrix, dim, degree, settings.petsc, contrast, listen, coarser)
        defaults = _WITH_ANOTHER
    else:
        is_direct = name == "direct"
        defaults = default_options(name, dim, matrix.getSize()[0], matrix.getComm())
    return KspTangents(matrix, defaults, settings.petsc, is_direct, listen)
