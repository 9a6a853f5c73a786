"""Linear algebra: which PETSc options a tangent is solved with, and how users override them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from petsc4py import PETSc

from contact_locking import _compat
from contact_locking.errors import InputError
from contact_locking.solver.linear.direct import SPARE_MEMORY, Substructuring
from contact_locking.solver.linear.factorised import chosen
from contact_locking.solver.linear.options import PREFIX, InsertedOptions, of_prefix

LINEAR_FAILURE = "the linear solve failed (solver.linear: direct is the most robust)"

#: A step like the last is a good start, but its residual, where cells are stiff, may be 1e6 times
#: the right-hand side until the first iteration has removed this part.  PETSc would call that
#: diverged.
FROM_ANY_START: dict[str, Any] = {"ksp_divtol": 1e300}

# By this name a KSP keeps its options.
_OPTIONS = "inserted_options"

_DIRECT: dict[str, Any] = {"ksp_type": "preonly", "pc_type": "cholesky"}
# On one rank CHOLMOD factorises in 60 (3D) to 80 % (2D) of MUMPS's time, after a fifth of its
# analysis.
_SERIAL_PACKAGE, _PARALLEL_PACKAGE = "cholmod", "mumps"
# A matrix that is not definite is an error of the KSP; CHOLMOD's own line about it says nothing to
# a user.  With nested dissection it factorises in 2D in 76 to 91 % of the time that its own choice
# of minimum degree takes; in 3D both take the same time.
_ORDERING = "pc_factor_mat_ordering_type"
_BY_CHOLMOD: dict[str, Any] = {
    "pc_factor_mat_solver_type": _SERIAL_PACKAGE,
    _ORDERING: PETSc.Mat.OrderingType.ND,
    "mat_cholmod_print": 0,
}
# How MUMPS shares its work among ranks depends on their timing: it needs more than it foresees.
_BY_MUMPS: dict[str, Any] = {
    **_DIRECT,
    "pc_factor_mat_solver_type": _PARALLEL_PACKAGE,
    "mat_mumps_icntl_14": SPARE_MEMORY,
}
# On several ranks each has CHOLMOD factorise its part, unless the user says anything of packages.
_IN_PIECES: dict[str, Any] = {**_DIRECT, "pc_type": "python"}
_OF_PACKAGES = ("pc_factor_", "mat_")
_MULTIGRID: dict[str, Any] = {
    "pc_type": "gamg",
    # Dropping weak couplings saves no iterations and doubles the set-up.
    "pc_gamg_threshold": 0.0,
    "mg_levels_ksp_type": "chebyshev",
    # With 4 steps CG takes a fifth fewer iterations, and a sixth more time.
    "mg_levels_ksp_max_it": 2,
}
# Node by node: on two ranks with the iterations of one, which SOR, each rank its own rows, has not,
# and a cycle takes two thirds of its time.
_BY_NODES: dict[str, Any] = {"mg_levels_pc_type": "pbjacobi"}
_BY_ROWS: dict[str, Any] = {"mg_levels_pc_type": "sor"}
# Galerkin products on one rank, with the transpose written out, take half the time.  Matrices of
# several ranks refuse this way, and the option is for all matrices of a process.
_PRODUCTS_ON_ONE_RANK: dict[str, Any] = {"matptap_via": "rap"}
_ITERATIVE: dict[str, Any] = {"ksp_type": "cg", "ksp_rtol": 1e-4, "ksp_max_it": 2000}


def default_options(linear: str, dim: int, size: int, comm: Any) -> dict[str, Any]:
    """PETSc options for an entry of :data:`LINEAR_SOLVERS`, or auto (by dimension and size).

    Raises InputError for a name without an entry.
    """
    name = chosen(linear, dim, size)
    if name not in LINEAR_SOLVERS:
        known = ", ".join(["auto", *LINEAR_SOLVERS])
        raise InputError(f"no linear solver {name!r}; there are: {known}", "solver.linear")
    return LINEAR_SOLVERS[name](comm)


def iterative_options(comm: Any = None) -> dict[str, Any]:
    """CG with algebraic multigrid."""
    return _ITERATIVE | multigrid_options()


def multigrid_options() -> dict[str, Any]:
    """A cycle of algebraic multigrid as a preconditioner."""
    return _MULTIGRID | (_BY_NODES if _compat.block_jacobi_follows_its_matrix() else _BY_ROWS)


def is_direct(linear: str, dim: int, size: int) -> bool:
    """Whether ``linear`` means a factorisation."""
    return chosen(linear, dim, size) == "direct"


def direct_options(comm: Any) -> dict[str, Any]:
    """A Cholesky factorisation by what suits the communicator (of mpi4py or PETSc)."""
    if comm.size == 1 and PETSc.Sys.hasExternalPackage(_SERIAL_PACKAGE):
        return {**_DIRECT, **_BY_CHOLMOD}
    return dict(_BY_MUMPS if comm.size == 1 else _IN_PIECES)


#: The linear solvers by name: PETSc options for a communicator.  The interior point method puts
#: the filtered multigrid in the place of the iterative one.
LINEAR_SOLVERS: dict[str, Callable[[Any], dict[str, Any]]] = {
    "direct": direct_options,
    "iterative": iterative_options,
}


def create_ksp(
    comm: Any,
    defaults: Mapping[str, Any],
    overrides: Mapping[str, Any] | None = None,
    prefix: str = PREFIX,
) -> PETSc.KSP:
    """A linear solver, yet without a matrix, that raises where it does not converge; collective.

    Its options stay in PETSc's database until :func:`factorise` or :func:`destroy_ksp`.
    """
    ksp = PETSc.KSP().create(comm)
    ksp.setErrorIfNotConverged(True)
    ksp.setAttr(_OPTIONS, configure([ksp], defaults, overrides, prefix))
    return ksp


class IterationListener:
    """Passes the number of each iteration of a linear solver on, and keeps what that raises.

    petsc4py may crash where an exception leaves a monitor.  So the exception waits: whoever solves
    calls :meth:`raise_kept` after the solve.
    """

    def __init__(self, ksp: PETSc.KSP, listen: Callable[[int], None]) -> None:
        self._listen = listen
        self._kept: BaseException | None = None
        ksp.setMonitor(self._hear)

    def _hear(self, _: PETSc.KSP, iteration: int, norm: float) -> None:
        if self._kept is not None:
            return
        try:
            self._listen(iteration)
        except BaseException as error:
            self._kept = error

    def raise_kept(self) -> None:
        """Raise what listening has raised since the last call, if anything."""
        kept, self._kept = self._kept, None
        if kept is not None:
            raise kept


def factorise(ksp: PETSc.KSP) -> None:
    """Factorise for all solves to come, and take the options out of the database; collective.

    A solver that is kept does not leave them there.
    """
    ksp.setUp()
    ksp.getAttr(_OPTIONS).remove()


def destroy_ksp(ksp: PETSc.KSP) -> None:
    """Free it, and take its options out of the database; collective."""
    if ksp:
        ksp.getAttr(_OPTIONS).remove()
        ksp.destroy()


def configure(
    solvers: Iterable[Any],
    defaults: Mapping[str, Any],
    overrides: Mapping[str, Any] | None = None,
    prefix: str = PREFIX,
) -> InsertedOptions:
    """Let PETSc's objects take their options, to be removed after their last solve; collective.

    Their prefix is one of their own, so that they take no options of another solver.
    """
    bare = _PRODUCTS_ON_ONE_RANK if PETSc.COMM_WORLD.size == 1 else {}
    fitting = _fitting(defaults, overrides, prefix)
    options = InsertedOptions(fitting, overrides, prefix, bare)
    try:
        for solver in solvers:
            solver.setOptionsPrefix(options.prefix)
            solver.setFromOptions()
            if fitting.items() >= _IN_PIECES.items() and isinstance(solver, PETSc.KSP):
                _complete(solver.getPC())
    except PETSc.Error:
        options.remove()
        raise
    return options


def _complete(pc: PETSc.PC) -> None:
    """An object of type python needs a context, unless it has one from before."""
    if pc.getType() == PETSc.PC.Type.PYTHON and pc.getPythonContext() is None:
        pc.setPythonContext(Substructuring())


def option(
    name: str,
    defaults: Mapping[str, Any],
    overrides: Mapping[str, Any] | None = None,
    prefix: str = PREFIX,
) -> Any:
    """The value of an option that defaults and the user's options lead to, None without one."""
    database = PETSc.Options(prefix)
    if database.hasName(name):
        return database.getString(name)
    return {**defaults, **of_prefix(overrides or {}, prefix)}.get(name)


def _fitting(
    defaults: Mapping[str, Any], overrides: Mapping[str, Any] | None, prefix: str
) -> dict[str, Any]:
    """The defaults, with the package that suits what the user wants.

    CHOLMOD has nothing but Cholesky's factorisation, and pieces take no options.
    """
    is_other = option("pc_type", defaults, overrides, prefix) != defaults.get("pc_type")
    if is_other and defaults.get("pc_factor_mat_solver_type") == _SERIAL_PACKAGE:
        bare = {name: value for name, value in defaults.items() if name != _ORDERING}
        return {**bare, "pc_factor_mat_solver_type": _PARALLEL_PACKAGE}
    names = {**PETSc.Options(prefix).getAll(), **of_prefix(overrides or {}, prefix)}
    is_of_package = any(name.startswith(_OF_PACKAGES) for name in names)
    if defaults.items() >= _IN_PIECES.items() and (is_other or is_of_package):
        return {**defaults, **_BY_MUMPS}
    return dict(defaults)
