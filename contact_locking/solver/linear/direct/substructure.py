"""One substructure: an interior that CHOLMOD eliminates, and a corner that others share."""

from __future__ import annotations

import functools
import hashlib
import importlib.machinery
import importlib.util
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import numpy.typing as npt
from dolfinx import jit
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import get_lapack_funcs

from contact_locking.arrays import FloatArray
from contact_locking.fem import compiled
from contact_locking.solver.linear.direct import substructure

# The C of this folder, compiled at its first use into the cache of compiled forms.
#
# Without it MUMPS solves: where ``CONTACT_LOCKING_NATIVE=0`` is set, PETSc has 64-bit indices, or
# there is no compiler or no header of CHOLMOD.

#: PETSc's type of an index; CHOLMOD's is that of C's int.
INDEX = np.dtype(PETSc.IntType)

# GCC vectorises sums only where a pragma lets it.
_ARGUMENTS = ("-std=c17", "-O3", "-fopenmp-simd")
_CHOLMOD = Path("suitesparse", "cholmod.h")


def is_available(comm: MPI.Intracomm) -> bool:
    """Whether the C is to be used and compiles on all ranks; collective."""
    wanted = os.environ.get("CONTACT_LOCKING_NATIVE") != "0"
    fits = INDEX.itemsize == np.dtype(np.intc).itemsize
    if not comm.allreduce(wanted and fits and cholmod() is not None, op=MPI.LAND):
        return False
    try:
        found, _ = library(comm)
    except (RuntimeError, cffi.VerificationError):
        # On several ranks DOLFINx tells all of them by a RuntimeError.
        return False
    return bool(comm.allreduce(found.substructure_has_its_library(), op=MPI.LAND))


def cholmod() -> Path | None:
    """The prefix of the installation that has CHOLMOD's header; None if none has."""
    for prefix in map(Path, (sys.prefix, sys.base_prefix, "/usr")):
        if (prefix / "include" / _CHOLMOD).is_file():
            return prefix
    return None


def library(comm: MPI.Intracomm) -> tuple[Any, Any]:
    """CFFI's ``lib`` and ``ffi`` of substructure.c; collective."""
    return jit.mpi_jit_decorator(_library)(comm)


@functools.cache
def _library() -> tuple[Any, Any]:
    prefix, here = cholmod(), Path(__file__).parent
    assert prefix is not None
    header, source = (here / f"substructure.{kind}" for kind in "hc")
    # Another version of CHOLMOD may have another layout of its data.
    read = [path.read_text("utf-8") for path in (header, source, prefix / "include" / _CHOLMOD)]
    name = hashlib.sha256("\n".join([*read, *_ARGUMENTS, str(prefix)]).encode()).hexdigest()[:32]
    module, folder = f"contact_locking_substructure_{name}", Path(compiled.options()["cache_dir"])
    path = folder / (module + importlib.machinery.EXTENSION_SUFFIXES[0])
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        builder = cffi.FFI()
        builder.cdef(read[0])
        builder.set_source(
            module,
            f'#include "{header.name}"',
            sources=[str(source)],
            libraries=["cholmod"],
            include_dirs=[str(here), str(prefix / "include")],
            library_dirs=[str(prefix / "lib")],
            extra_compile_args=list(_ARGUMENTS),
        )
        # Another process may compile at the same time: only a complete module enters the cache.
        with tempfile.TemporaryDirectory(prefix=module, dir=folder) as unfinished:
            Path(builder.compile(tmpdir=unfinished)).replace(path)
    spec = importlib.util.spec_from_file_location(module, path)
    assert spec is not None and spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded.lib, loaded.ffi


Numbers = npt.NDArray[np.integer]


class Substructure:
    """``P A P^T = L L^T`` with the interior first; collective to make.

    The corner of L is kept with its rows and columns in reverse order, as an upper triangle U.
    ``order`` are the interior's numbers in the order of elimination, then those of the corner, of
    which there is one at least.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        interior: Numbers,
        corner: Numbers,
        comm: MPI.Intracomm,
    ) -> None:
        self._library, self._ffi = substructure.library(comm)
        starts, columns, _ = matrix.getValuesCSR()
        self.order = np.concatenate([interior, corner]).astype(np.int32)
        # CHOLMOD keeps no copy of the pattern.
        self._pattern = [self._ints(starts), self._ints(columns)]
        sizes = len(self.order), *self._pattern, len(interior)
        made = self._library.substructure_new(*sizes, self._ints(self.order))
        self.has_memory = bool(made)
        self._made = self._ffi.gc(made, self._library.substructure_free) if made else made
        self._corner = np.empty((len(corner), len(corner)), order="F")
        self._vector = np.empty(len(self.order))
        (self._lauum,) = get_lapack_funcs(("lauum",))
        self._inside = self._vector[: len(interior)]
        self._reversed = self._vector[len(interior) :][::-1]

    def factorise(self, values: FloatArray) -> bool:
        """Whether a matrix with these values is positive definite, and L exists."""
        corner = self._numbers(self._corner.reshape(-1, order="F"))
        return not self._library.substructure_factorise(self._made, self._numbers(values), corner)

    def complement(self) -> FloatArray:
        """``U U^T``, its upper triangle: the Schur complement of the interior."""
        product, _ = self._lauum(self._corner)
        return np.asarray(product)

    def forward(self, interior: FloatArray) -> FloatArray:
        """``-A_GI A_I^-1 b`` for a right-hand side b inside; to be followed by ``backward``."""
        self._vector[:] = 0.0
        self._inside[:] = interior
        self._library.substructure_forward(self._made, self._numbers(self._vector))
        return self._reversed.copy()

    def backward(self, corner: FloatArray) -> FloatArray:
        """The solution inside for the solution in the corner."""
        self._reversed[:] = corner
        self._library.substructure_backward(self._made, self._numbers(self._vector))
        return self._inside

    def _ints(self, array: npt.NDArray[Any]) -> Any:
        return self._ffi.from_buffer("int[]", np.ascontiguousarray(array, dtype=np.int32))

    def _numbers(self, array: FloatArray) -> Any:
        return self._ffi.from_buffer("double[]", array)
