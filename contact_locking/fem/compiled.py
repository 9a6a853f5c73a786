"""UFL forms and expressions, compiled by DOLFINx into a folder of this package's own."""

from __future__ import annotations

import contextlib
import io
import os
import zlib
from collections.abc import Callable, Hashable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import dolfinx
import ffcx
import ufl
from dolfinx import fem, jit, la
from mpi4py import MPI

from contact_locking import _compat
from contact_locking.arrays import FloatArray
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
    given = jit.get_options()
    versions = f"dolfinx-{dolfinx.__version__}-ffcx-{ffcx.__version__}"
    folder = given["cache_dir"] / f"contact-locking-{versions}"
    return {"cache_dir": folder, "timeout": max(_TIMEOUT, given["timeout"])}


class Kept:
    """Compiled forms and evaluated data of one problem, by names, for its next solve."""

    def __init__(self) -> None:
        self._found: dict[Hashable, Any] = {}

    def __call__(self, name: Hashable, make: Callable[[], T]) -> T:
        """The result of the first call of :func:`make` with the name; collective if that is."""
        if name not in self._found:
            self._found[name] = make()
        found: T = self._found[name]
        return found

    def form(self, integrals: ufl.Form) -> fem.Form:
        """The compiled form of a UFL form, of one that is equal if there is one; collective."""
        return self(integrals, lambda: form(integrals))


@contextlib.contextmanager
def _compiling(comm: MPI.Intracomm, signature: str) -> Iterator[dict[str, Any]]:
    """Let one process compile at a time, into a folder where no form is half there; collective.

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
    """The lock file of a folder, locked; None where there are no locks, or no leave to write."""
    from contact_locking.files.atomic import try_lock  # only where something is compiled

    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = io.FileIO(os.open(folder / "compiling", os.O_RDWR | os.O_CREAT, 0o666), "r+")
    except OSError:
        yield None
        return
    with file:
        yield file if try_lock(file.fileno(), waits=True) else None


def _remove_unfinished(folder: Path) -> None:
    """Remove C files that have no compiled module, and the signs of modules without a C file."""
    sources = {path.with_suffix("") for path in folder.glob("*.c")}
    modules = {path.with_suffix("").with_suffix("") for path in folder.glob("*.c.cached")}
    for stem in sources - modules:
        stem.with_suffix(".c").unlink(missing_ok=True)
    for stem in modules - sources:
        stem.with_suffix(".c.cached").unlink(missing_ok=True)
