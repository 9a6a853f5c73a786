"""Forms, and functions of C, as compiled code for the processor at hand.

``dolfinx_jit_options.json``, where DOLFINx reads such options, overrides what is set here.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.machinery
import importlib.util
import tempfile
from pathlib import Path
from typing import Any

import cffi
from dolfinx import fem, jit
from mpi4py import MPI

_ARGUMENTS = "cffi_extra_compile_args"
# Square roots that have to tell of errors are not vectorised.
_FOR_LIBRARIES = ("-std=c17", "-fno-math-errno")


def form(integrals: Any) -> fem.Form:
    """A UFL form, compiled."""
    return fem.form(integrals, jit_options=options())


def library(name: str, header: str, source: str, comm: MPI.Intracomm) -> tuple[Any, Any]:
    """Functions of C, as CFFI's ``lib``, and its ``ffi``; collective.

    ``header`` declares them.  They are kept in the cache of the forms, under a name that depends on
    all that they are made of, and compiled with the same options.
    """
    return jit.mpi_jit_decorator(_library)(comm, name, header, source)


@functools.cache
def _library(name: str, header: str, source: str) -> tuple[Any, Any]:
    found = jit.get_options(options())
    arguments = [*found[_ARGUMENTS], *_FOR_LIBRARIES]
    cache = Path(found["cache_dir"])
    made_of = "\n".join([header, source, *arguments])
    module = f"libcontact_locking_{name}_{hashlib.sha256(made_of.encode()).hexdigest()[:32]}"
    path = cache / (module + importlib.machinery.EXTENSION_SUFFIXES[0])
    if not path.exists():
        cache.mkdir(parents=True, exist_ok=True)
        # Another process may be at it, too: what is in the cache is complete.
        with tempfile.TemporaryDirectory(prefix=module, dir=cache) as folder:
            builder = cffi.FFI()
            builder.cdef(header)
            builder.set_source(module, header + source, extra_compile_args=arguments)
            Path(builder.compile(tmpdir=folder)).replace(path)
    spec = importlib.util.spec_from_file_location(module, path)
    assert spec is not None and spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded.lib, loaded.ffi


@functools.cache
def options() -> dict[str, Any]:
    """DOLFINx's options for the compiler: ``-O3 -march=native`` unless the user has others.

    The name of a compiled form in the cache depends on them.  So that processors that share a cache
    do not get each other's instructions, there is one more, which names the processor; where
    nothing is known of it, DOLFINx's own options stay.
    """
    default, _ = jit.DOLFINX_DEFAULT_JIT_OPTIONS[_ARGUMENTS]
    instructions = _instructions()
    if jit.get_options()[_ARGUMENTS] != default or not instructions:
        return {}
    processor = hashlib.sha256("\n".join(instructions).encode()).hexdigest()[:16]
    return {_ARGUMENTS: ["-O3", "-march=native", "-g0", f"-DPROCESSOR_{processor}"]}


def _instructions() -> list[str]:
    """What Linux says of model and instructions of the first processor; elsewhere nothing."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").partition("\n\n")[0].splitlines()
    except OSError:
        return []
    named = ("model", "stepping", "flags", "CPU", "Features", "isa")
    return [line for line in lines if line.startswith(named)]
