"""Linear solvers of PETSc: their options, how users override them, and how matrices are stored.

Options are in PETSc's database as long as a solver lives.  A matrix is stored in blocks of a node's
components, where products and assembly take half the time, or entry by entry, as factorisations and
the Galerkin products of multigrid know nothing of blocks.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from petsc4py import PETSc

from contact_locking import _compat
from contact_locking.errors import InputError
from contact_locking.solver.linear.factorised import chosen

PREFIX = "contact_locking_"

_NUMBERS = itertools.count(1)

# Galerkin products on one rank, with the transpose written out, take half the time.  Matrices of
# several ranks refuse this way, and PETSc asks for it without a prefix.
_PRODUCTS_ON_ONE_RANK: dict[str, Any] = {"matptap_via": "rap"}


class UserOptions(dict[str, Any]):
    """Options of the user, without prefix; ``used`` are the names that PETSc has asked for."""

    def __init__(self, options: Mapping[str, Any] | None = None) -> None:
        super().__init__(options or {})
        self.used: set[str] = set()

    def unused(self) -> list[str]:
        """The options without effect, with those of the user's own database under the prefix."""
        names = [name for name in self if name not in self.used]
        for name in PETSc.Options(PREFIX).getAll():
            if name not in self and not _compat.petsc_option_used(PREFIX + name):
                names.append(name)
        return names


class InsertedOptions:
    """Options for one solver in PETSc's database, until they are removed.

    They stand under ``prefix`` of this object, which no other solver has.  To be removed only after
    the last solve: levels of multigrid and factorisations ask for theirs when they are set up, and
    again whenever that is repeated.  Options that the user has in the database under the prefix
    that is given (``-contact_locking_...``) win over those of ``overrides``, and those over
    ``defaults``.
    """

    def __init__(
        self,
        defaults: Mapping[str, Any],
        overrides: Mapping[str, Any] | None = None,
        prefix: str = PREFIX,
    ) -> None:
        self.prefix, self._shared = f"solver{next(_NUMBERS)}_{prefix}", prefix
        self._user = overrides if isinstance(overrides, UserOptions) else UserOptions()
        self._of_database = PETSc.Options(prefix).getAll()
        self._ours = {**defaults, **of_prefix(overrides or {}, prefix), **self._of_database}
        database = PETSc.Options(self.prefix)
        for key, value in self._ours.items():
            database.setValue(key, value)
        bare = _PRODUCTS_ON_ONE_RANK if PETSc.COMM_WORLD.size == 1 else {}
        present = PETSc.Options().getAll()
        self._bare = {name: value for name, value in bare.items() if name not in present}
        for name, value in self._bare.items():
            PETSc.Options().setValue(name, value)

    def remove(self) -> None:
        """Take them out again, and remember which were asked for; more than once does no harm."""
        database, part = PETSc.Options(self.prefix), self._shared.removeprefix(PREFIX)
        for key in self._ours:
            if _compat.petsc_option_used(self.prefix + key):
                if key in self._of_database:
                    # To ask for it makes it used.
                    PETSc.Options(self._shared).hasName(key)
                self._user.used |= {name for name in self._user if name.lower() == part + key}
            database.delValue(key)
        for name in self._bare:
            PETSc.Options().delValue(name)
        self._ours, self._bare = {}, {}


def of_prefix(options: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """The options of the user for the solvers under a prefix, without what it adds to PREFIX."""
    part = prefix.removeprefix(PREFIX)
    return {
        name.removeprefix(part).lower(): value
        for name, value in options.items()
        if name.startswith(part)
    }


IN_BLOCKS, BY_ENTRY = "baij", "aij"


class Unblocked:
    """A matrix stored in blocks as every preconditioner can do with it."""

    def __init__(self) -> None:
        self._copy: PETSc.Mat | None = None

    def of(self, matrix: PETSc.Mat) -> PETSc.Mat:
        """The same matrix for all matrices of one pattern, with the values of this; collective.

        A matrix of one rank that is stored by entry is returned itself.
        """
        if matrix.getType() == PETSc.Mat.Type.SEQAIJ:
            matrix.setOption(PETSc.Mat.Option.SPD, True)
            return matrix
        if self._copy is None:
            self._copy = matrix.convert(BY_ENTRY, PETSc.Mat())
            self._copy.setNearNullSpace(matrix.getNearNullSpace())
        else:
            matrix.convert(BY_ENTRY, self._copy)
        # PETSc forgets it with each new value.
        self._copy.setOption(PETSc.Mat.Option.SPD, True)
        return self._copy

    def destroy(self) -> None:
        """Free the matrix; collective."""
        if self._copy is not None:
            self._copy.destroy()


def stacked(matrices: Sequence[PETSc.Mat]) -> PETSc.Mat:
    """The rows of the matrices, one matrix after another on each rank, which it destroys."""
    nest = PETSc.Mat().createNest([[matrix] for matrix in matrices], comm=matrices[0].getComm())
    rows = nest.convert(BY_ENTRY, PETSc.Mat())
    for item in (nest, *matrices):
        item.destroy()
    return rows


LINEAR_FAILURE = "the linear solve failed (solver.linear: direct is the most robust)"

#: A step like the last is a good start, but its residual, where cells are stiff, may be 1e6 times
#: the right-hand side until the first iteration has removed this part.  PETSc would call that
#: diverged.
FROM_ANY_START: dict[str, Any] = {"ksp_divtol": 1e300}

# By this name a KSP keeps its options.
_OPTIONS = "inserted_options"

# On one rank CHOLMOD factorises in 60 (3D) to 80 % (2D) of MUMPS's time, after a fifth of its
# analysis.  A matrix that is not definite is an error of the KSP; CHOLMOD's own line about it says
# nothing to a user.  With nested dissection it factorises in 2D in 76 to 91 % of the time that its
# own choice of minimum degree takes; in 3D both take the same time.
_DIRECT: dict[str, Any] = {"ksp_type": "preonly", "pc_type": "cholesky"}
_BY_CHOLMOD: dict[str, Any] = {
    **_DIRECT,
    "pc_factor_mat_solver_type": "cholmod",
    "pc_factor_mat_ordering_type": PETSc.Mat.OrderingType.ND,
    "mat_cholmod_print": 0,
}
# How MUMPS shares its work among ranks depends on their timing: by so many per cent it may need
# more memory than it foresees.
_BY_MUMPS: dict[str, Any] = {
    **_DIRECT,
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_14": 80,
}


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
    return {"ksp_type": "cg", "ksp_rtol": 1e-4, "ksp_max_it": 2000, **multigrid_options()}


def multigrid_options() -> dict[str, Any]:
    """A cycle of algebraic multigrid as a preconditioner."""
    return {
        "pc_type": "gamg",
        # Dropping weak couplings saves no iterations and doubles the set-up.
        "pc_gamg_threshold": 0.0,
        "mg_levels_ksp_type": "chebyshev",
        # With 4 steps CG takes a fifth fewer iterations, and a sixth more time.
        "mg_levels_ksp_max_it": 2,
        # Node by node: on two ranks with the iterations of one, which SOR, each rank its own rows,
        # has not, and a cycle takes two thirds of its time.
        "mg_levels_pc_type": "pbjacobi" if _compat.block_jacobi_follows_its_matrix() else "sor",
    }


def is_direct(linear: str, dim: int, size: int) -> bool:
    """Whether ``linear`` means a factorisation."""
    return chosen(linear, dim, size) == "direct"


def direct_options(comm: Any) -> dict[str, Any]:
    """A Cholesky factorisation by what suits the communicator (of mpi4py or PETSc)."""
    by_cholmod = comm.size == 1 and PETSc.Sys.hasExternalPackage("cholmod")
    return dict(_BY_CHOLMOD if by_cholmod else _BY_MUMPS)


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
    is_other = option("pc_type", defaults, overrides, prefix) != defaults.get("pc_type")
    if is_other and defaults.items() >= _BY_CHOLMOD.items():
        # CHOLMOD has nothing but Cholesky's factorisation.
        others = {key: value for key, value in defaults.items() if key not in _BY_CHOLMOD}
        defaults = others | _BY_MUMPS
    options = InsertedOptions(defaults, overrides, prefix)
    try:
        for solver in solvers:
            solver.setOptionsPrefix(options.prefix)
            solver.setFromOptions()
    except PETSc.Error:
        options.remove()
        raise
    return options


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
