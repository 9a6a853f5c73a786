"""UFL forms and expressions, compiled by DOLFINx into a cache folder of this package.

The integrals of a :class:`JointForm` are compiled separately and assembled together.  DOLFINx
stores all coefficients of a form for each of its cells and facets, so that cells and facets have
separate forms: no cell stores the coefficients of facets.

FFCx 0.9 treats values at the only point of a quadrature rule as constant in the cell, and does so
in the other rules of the same form, too.  Integrals that evaluate the coordinates at one point, as
those of an axisymmetric body with linear displacements do, therefore have separate forms.  For the
same reason a traction at the one point of a facet would be lost beside the nodes of a contact:
each quadrature rule on facets has its own form.
"""

from __future__ import annotations

import contextlib
import io
import os
import zlib
from collections.abc import Callable, Hashable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import dolfinx
import ffcx
import ufl
from dolfinx import fem, jit, la
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc
from ufl.algorithms.analysis import extract_type

from contact_locking import _compat
from contact_locking.arrays import FloatArray
from contact_locking.fem.contact_operator import ContactOperator
from contact_locking.mesh.domain import Domain

T = TypeVar("T")

# How long to wait for a form that another process compiles: the longest compilation, of the
# tangent of Newton's method in 3D, takes some ten seconds on a busy machine.
_TIMEOUT = 60


def form(integrals: Any) -> fem.Form:
    """The compiled form of a UFL form; collective."""
    (mesh, *_) = integrals.ufl_domains()
    with _compiling(mesh.ufl_cargo().comm, integrals.signature()) as chosen:
        return fem.form(integrals, jit_options=chosen)


def integral(domain: Domain, integrals: Any) -> float:
    """The value of a functional; collective."""
    return float(domain.comm.allreduce(fem.assemble_scalar(form(integrals))))


def assembled(linear: fem.Form | ufl.Form) -> FloatArray:
    """The values of a linear form, compiled or not, at local dofs, ghosts included; collective."""
    vector = fem.assemble_vector(form(linear) if isinstance(linear, ufl.Form) else linear)
    vector.scatter_reverse(la.InsertMode.add)
    vector.scatter_forward()
    return vector.array


def expression(value: Any, points: FloatArray) -> fem.Expression:
    """The compiled UFL expression at points (k, d) of the reference cell; collective."""
    comm = ufl.domain.extract_unique_domain(value).ufl_cargo().comm
    kind = f"{type(value).__name__} {value.ufl_shape} {points.shape}"
    with _compiling(comm, kind) as chosen:
        return fem.Expression(value, points, comm=comm, jit_options=chosen)


def interpolation(value: Any, space: fem.FunctionSpace) -> fem.Expression:
    """The compiled UFL expression that DOLFINx interpolates into ``space``; collective."""
    return expression(_compat.of_mesh(value, space.mesh), _compat.interpolation_points(space))


def options() -> dict[str, Any]:
    """DOLFINx's ``jit_options``: a folder of this package's own in its cache, and a timeout.

    The user's ``dolfinx_jit_options.json`` gives the compiler's options, the place of the cache,
    and a longer timeout.
    """
    defaults = jit.get_options()
    versions = f"dolfinx-{dolfinx.__version__}-ffcx-{ffcx.__version__}"
    folder = defaults["cache_dir"] / f"contact-locking-{versions}"
    return {"cache_dir": folder, "timeout": max(_TIMEOUT, defaults["timeout"])}


class Kept:
    """Compiled forms and evaluated data of one problem, by name, for reuse in later solves."""

    def __init__(self) -> None:
        self._values: dict[Hashable, Any] = {}

    def __call__(self, name: Hashable, make: Callable[[], T]) -> T:
        """The result of the first call of :func:`make` with the name; collective if that is."""
        if name not in self._values:
            self._values[name] = make()
        result: T = self._values[name]
        return result

    def form(self, integrals: ufl.Form) -> fem.Form:
        """The compiled form of a UFL form, compiled once for all equal forms; collective."""
        return self(integrals, lambda: form(integrals))


@contextlib.contextmanager
def _compiling(comm: MPI.Intracomm, signature: str) -> Iterator[dict[str, Any]]:
    """Let one process compile at a time, into a folder without unfinished forms; collective.

    Yields DOLFINx's ``jit_options``.  There are 256 folders, by signature: Python lists the whole
    folder of a module that it imports, and processes do not wait for each other's forms.

    FFCx creates the C file of a form before the compilation, and a second file afterwards for which
    the other processes wait.  A process that ends in between, or a full disk, leaves one file
    without the other, and the form is never ready.  So the lock file has a byte while a form is
    compiled, and a process that finds one there removes the files without their partner.
    """
    # The first rank compiles.  The others must not wait for its lock with forms of their own while
    # it waits for them.
    comm.barrier()
    chosen = options()
    folder = chosen["cache_dir"] / f"{zlib.crc32(signature.encode()) & 0xFF:02x}"
    with contextlib.ExitStack() as stack:
        file = stack.enter_context(_lock(folder)) if comm.rank == 0 else None
        if file is not None:
            if file.read(1):
                _remove_unfinished(folder)
            else:
                file.write(b"1")
        yield chosen | {"cache_dir": folder}
        if file is not None:
            file.truncate(0)


@contextlib.contextmanager
def _lock(folder: Path) -> Iterator[io.FileIO | None]:
    """The lock file of a folder, locked; None without locks or permission to write there."""
    from contact_locking.files import try_lock  # only where something is compiled

    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = io.FileIO(os.open(folder / "compiling", os.O_RDWR | os.O_CREAT, 0o666), "r+")
    except OSError:
        yield None
        return
    with file:
        yield file if try_lock(file.fileno(), waits=True) else None


def _remove_unfinished(folder: Path) -> None:
    """Remove C files without a compiled module, and the marks of modules without a C file."""
    sources = {path.with_suffix("") for path in folder.glob("*.c")}
    modules = {path.with_suffix("").with_suffix("") for path in folder.glob("*.c.cached")}
    for stem in sources - modules:
        stem.with_suffix(".c").unlink(missing_ok=True)
    for stem in modules - sources:
        stem.with_suffix(".c.cached").unlink(missing_ok=True)


# The name under which a PETSc matrix keeps the DOLFINx matrix whose arrays it shares.
_SHARED = "shared_with_dolfinx"


def compiled_together(form: ufl.Form) -> list[ufl.Form]:
    """The integrals of a form, in forms that can be compiled together, those of cells first.

    These are one form for the cells and one for each quadrature rule of the facets, or two if some
    integrals evaluate the coordinates in one point; and one for each object of mesh tags, of which
    DOLFINx takes one for all integrals of a form.
    """
    groups: dict[Any, list[Any]] = {}
    for integral in form.integrals():
        kind, tags = integral.integral_type(), id(integral.subdomain_data())
        metadata, has_place = integral.metadata(), False
        if metadata.get("quadrature_degree", 2) <= 1:
            has_place = bool(extract_type(integral, ufl.SpatialCoordinate))
        rule = None if kind == "cell" else metadata.get("quadrature_rule")
        groups.setdefault((kind, rule, has_place, tags), []).append(integral)

    def rank(integrals: list[Any]) -> tuple[bool, bool]:
        # Forms over all cells are first, as they have all entries of a matrix.
        is_everywhere = any(integral.subdomain_id() == "everywhere" for integral in integrals)
        return integrals[0].integral_type() != "cell", not is_everywhere

    return [ufl.Form(integrals) for integrals in sorted(groups.values(), key=rank)]


class JointForm:
    """A compiled form, in the parts of :func:`compiled_together`, each by ``compile_form``."""

    def __init__(self, form: ufl.Form, compile_form: Callable[[ufl.Form], fem.Form] = form) -> None:
        self._forms = [compile_form(integrals) for integrals in compiled_together(form)]

    def create_matrix(
        self, operators: Sequence[ContactOperator] = (), kind: str | None = None
    ) -> PETSc.Mat:
        """A matrix with the entries of the cells' integrals and of ``operators``; collective."""
        others = [operator for operator in operators if operator.couples_cells]
        if not others:
            return petsc.create_matrix(self._forms[0], kind)
        matrix = petsc.create_matrix(self._forms[0])
        # PETSc forgets the places of entries that nobody has given a value.
        petsc.assemble_matrix(matrix, self._forms[0])
        matrix.assemble()
        numbering = matrix.getLGMap()
        for operator in others:
            pattern = operator.pattern(matrix)
            matrix.axpy(1.0, pattern, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            pattern.destroy()
        if kind is not None:
            matrix.convert(kind)
        matrix.setLGMap(*numbering)
        return matrix

    def create_shared_matrix(self, operators: Sequence[ContactOperator] = ()) -> PETSc.Mat:
        """The same on one rank, stored entry by entry, with the arrays of a matrix of DOLFINx.

        DOLFINx assembles into its own matrix as fast as into one in blocks, which a factorisation
        would have to copy.  With entries that couple cells the matrix is PETSc's own.
        """
        if any(operator.couples_cells for operator in operators):
            return self.create_matrix(operators)
        shared = fem.create_matrix(self._forms[0], block_mode=la.BlockMode.expanded)
        starts, columns = (array.astype(PETSc.IntType) for array in (shared.indptr, shared.indices))
        size, components = len(starts) - 1, self._forms[0].function_spaces[0].dofmap.index_map_bs
        matrix = PETSc.Mat().createAIJWithArrays(
            (size, size), (starts, columns, shared.data), comm=PETSc.COMM_SELF
        )
        matrix.setBlockSize(components)
        matrix.setAttr(_SHARED, shared)
        return matrix

    def assemble_vector(self, vector: la.Vector) -> None:
        """Set the owned values of a vector of the displacements to the linear form; collective."""
        vector.array[:] = 0.0
        for form in self._forms:
            fem.assemble_vector(vector.array, form)
        vector.scatter_reverse(la.InsertMode.add)

    def assemble_matrix(self, matrix: PETSc.Mat, conditions: Sequence[fem.DirichletBC]) -> None:
        """Set a matrix, with the identity at the conditions of displacements; collective."""
        matrix.zeroEntries()
        shared = matrix.getAttr(_SHARED)
        for number, form in enumerate(self._forms):
            if number > 0:
                # The identity was inserted last, and now values are added.
                matrix.assemble(PETSc.Mat.AssemblyType.FLUSH)
            if shared is None:
                petsc.assemble_matrix(matrix, form, bcs=list(conditions))
            else:
                fem.assemble_matrix(shared, form, list(conditions))
        matrix.assemble()
