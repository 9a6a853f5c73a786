"""Linear solvers of PETSc: direct or iterative by size, their options, and how matrices are stored.

Options are in PETSc's database as long as a solver lives, and those of the user override others.  A
matrix is stored in blocks of a node's components, where products and assembly take half the time,
or entry by entry, as factorisations and the Galerkin products of multigrid know nothing of blocks.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from petsc4py import PETSc

from contact_locking import _compat
from contact_locking.errors import NotConverged, raise_callback_error

# Above these many unknowns, by dimension, GMRES takes over; below, the direct solver is as fast or
# nearly so, and it never fails.  In 3D they are even at 25 000, and at 110 000 GMRES takes half the
# time.
DIRECT_LIMIT = {2: 1_000_000, 3: 50_000}
# So many unknowns are filtered at most, by dimension and degree of the elements.  With linear
# elements in 3D a filter of 70 000 unknowns takes as long as the projection, and with 130 000 it
# takes longer.  With quadratic elements the projection takes several times as long as the filter;
# beyond this limit the filter's memory would be that of the whole solve again.
FILTER_LIMIT = {(2, 1): 1_000_000, (2, 2): 1_000_000, (3, 1): 100_000, (3, 2): 300_000}
# Bytes, measured with DOLFINx 0.9, OpenBLAS and CHOLMOD: of a rank with all libraries; of an
# unknown in 2D with its factor, and in 3D without; and in 3D of the factor, which grows like a
# power of the unknowns, and of an unknown in place of the factor beside GMRES.
_RANK, _UNKNOWN, _FACTOR, _ITERATIVE = 0.23e9, {2: 3.2e3, 3: 5.6e3}, (145.0, 4 / 3), 5.5e3


def is_direct(linear: str, dim: int, size: int) -> bool:
    """Whether ``linear`` means a factorisation, as auto does by dimension and size.

    ``size`` are the unknowns of a cube that takes as long to factorise.
    """
    return size <= DIRECT_LIMIT[dim] if linear == "auto" else linear == "direct"


def estimated_memory(linear: str, dim: int, unknowns: int, size: int, ranks: int) -> float:
    """About the bytes that a solve takes on all ranks together; ``size`` as in `is_direct`.

    Nobody knows before the solve how much of the body locks.
    """
    memory = ranks * _RANK + _UNKNOWN[dim] * unknowns
    if dim == 2:
        return memory
    if not is_direct(linear, dim, size):
        return memory + _ITERATIVE * unknowns
    coefficient, power = _FACTOR
    # A factor in pieces on several ranks takes twice the memory.
    return memory + (2.0 if ranks > 1 else 1.0) * coefficient * size**power


PREFIX = "contact_locking_"

_NUMBERS = itertools.count(1)

# Galerkin products on one rank, with the transpose written out, take half the time.  Matrices of
# several ranks refuse this way, and PETSc asks for it without a prefix.
_PRODUCTS_ON_ONE_RANK = "matptap_via", "rap"


class UserOptions(dict[str, Any]):
    """Options of the user, without prefix; ``used`` are those, in lower case, PETSc asked for."""

    def __init__(self, options: Mapping[str, Any] | None = None) -> None:
        super().__init__(options or {})
        self.used: set[str] = set()

    def unused(self) -> list[str]:
        """The options without effect, with those of the user's own database under the prefix."""
        names = [name for name in self if name.lower() not in self.used]
        for name in PETSc.Options(PREFIX).getAll():
            if name not in self and not _compat.petsc_option_used(PREFIX + name):
                names.append(name)
        return names


def user_options(options: Mapping[str, Any], prefix: str = PREFIX) -> dict[str, Any]:
    """Options of the user under a prefix: PETSc's database wins over ``options``."""
    part = prefix.removeprefix(PREFIX)
    named = {key.removeprefix(part): options[key] for key in options if key.startswith(part)}
    return {key.lower(): value for key, value in named.items()} | PETSc.Options(prefix).getAll()


class InsertedOptions:
    """Options that ``solvers`` take from PETSc's database, until they are removed; collective.

    They stand under a prefix of their own, so that the solvers take no options of others.  To be
    removed only after the last solve: levels of multigrid and factorisations ask for theirs when
    they are set up, and again whenever that is repeated.  :func:`user_options` win over
    ``defaults``.
    """

    def __init__(
        self,
        solvers: Iterable[Any],
        defaults: Mapping[str, Any],
        overrides: Mapping[str, Any] | None = None,
        prefix: str = PREFIX,
    ) -> None:
        self._prefix, self._shared = f"solver{next(_NUMBERS)}_{prefix}", prefix
        self._user = overrides if isinstance(overrides, UserOptions) else UserOptions()
        by_user = user_options(overrides or {}, prefix)
        if (
            by_user.get("pc_type", "cholesky") != "cholesky"
            and _CHOLMOD.items() <= defaults.items()
        ):
            # CHOLMOD has nothing but Cholesky's factorisation.
            defaults = {**defaults, **_MUMPS}
        self._ours, database = {**defaults, **by_user}, PETSc.Options()
        for key, value in self._ours.items():
            database.setValue(self._prefix + key, value)
        name, value = _PRODUCTS_ON_ONE_RANK
        self._sets_products = PETSc.COMM_WORLD.size == 1 and not database.hasName(name)
        if self._sets_products:
            database.setValue(name, value)
        try:
            for solver in solvers:
                solver.setOptionsPrefix(self._prefix)
                solver.setFromOptions()
        except PETSc.Error:
            self.remove()
            raise

    def remove(self) -> None:
        """Take them out again, and remember which were asked for; more than once does no harm."""
        database, part = PETSc.Options(), self._shared.removeprefix(PREFIX)
        for key in self._ours:
            if _compat.petsc_option_used(self._prefix + key):
                # To ask for it makes it used.
                database.hasName(self._shared + key)
                self._user.used.add(part + key)
            database.delValue(self._prefix + key)
        if self._sets_products:
            database.delValue(_PRODUCTS_ON_ONE_RANK[0])
        self._ours, self._sets_products = {}, False


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
    for petsc_object in (nest, *matrices):
        petsc_object.destroy()
    return rows


class LinearFailure(NotConverged):
    """A linear solve that failed."""

    code = "solver.linear"

    def __init__(self) -> None:
        super().__init__("the linear solve failed (solver.linear: direct is the most robust)")


@contextlib.contextmanager
def linear_failures() -> Iterator[None]:
    """Errors of PETSc as NotConverged."""
    try:
        yield
    except PETSc.Error as error:
        raise_callback_error(error)
        raise LinearFailure from error


#: A step like the last is a good start, but its residual, where cells are stiff, may be 1e6 times
#: the right-hand side until the first iteration has removed this part.  PETSc would call that
#: diverged.
FROM_ANY_START: dict[str, Any] = {"ksp_divtol": 1e300}

# By this name a KSP keeps its options.
_OPTIONS = "inserted_options"

_DIRECT: dict[str, Any] = {"ksp_type": "preonly", "pc_type": "cholesky"}
# On one rank CHOLMOD factorises in 60 (3D) to 80 % (2D) of MUMPS's time, after a fifth of its
# analysis.  A matrix that is not definite is an error of the KSP; CHOLMOD's own line about it says
# nothing to a user.  With nested dissection it factorises in 2D in 76 to 91 % of the time that its
# own choice of minimum degree takes; in 3D both take the same time.
_CHOLMOD: dict[str, Any] = {
    "pc_factor_mat_solver_type": "cholmod",
    "pc_factor_mat_ordering_type": PETSc.Mat.OrderingType.ND,
    "mat_cholmod_print": 0,
}
# How MUMPS shares its work among ranks depends on their timing: by so many per cent it may need
# more memory than it foresees.
_MUMPS: dict[str, Any] = {"pc_factor_mat_solver_type": "mumps", "mat_mumps_icntl_14": 80}


def default_options(linear: str, dim: int, size: int, comm: Any) -> dict[str, Any]:
    """PETSc options for direct, iterative, or auto (by dimension and size)."""
    return direct_options(comm) if is_direct(linear, dim, size) else iterative_options()


def direct_options(comm: Any) -> dict[str, Any]:
    """A Cholesky factorisation by what suits the communicator (of mpi4py or PETSc)."""
    by_cholmod = comm.size == 1 and PETSc.Sys.hasExternalPackage("cholmod")
    return _DIRECT | (_CHOLMOD if by_cholmod else _MUMPS)


def iterative_options() -> dict[str, Any]:
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
    ksp.setAttr(_OPTIONS, InsertedOptions([ksp], defaults, overrides, prefix))
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
