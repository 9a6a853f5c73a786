"""The C of this folder, compiled at its first use into the cache of compiled forms.

Without it MUMPS solves: where ``CONTACT_LOCKING_NATIVE=0`` is set, PETSc has 64-bit indices, or
there is no compiler or no header of CHOLMOD.
"""

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
from dolfinx import jit
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.fem import compiled

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
