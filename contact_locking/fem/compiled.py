"""UFL forms and C functions, compiled for the processor of this machine.

The user's ``~/.config/dolfinx/dolfinx_jit_options.json`` overrides the compiler options here.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.machinery
import importlib.util
import sys
import tempfile
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import cffi
from dolfinx import fem, jit
from mpi4py import MPI

from contact_locking.fem import compiled_forms, kept_forms

_ARGUMENTS = "cffi_extra_compile_args"
# GCC vectorises square roots only if they need not set errno, and sums only where a pragma lets it.
_FOR_LIBRARIES = ("-std=c17", "-fno-math-errno", "-fopenmp-simd")


class Installed(NamedTuple):
    """An installed C library: its name, the prefix of the installation, and the header."""

    name: str
    prefix: Path
    header: Path


def form(integrals: Any) -> fem.Form:
    """The compiled form of a UFL form."""
    with compiled_forms.explained():
        return fem.form(integrals, jit_options=options())


def library(
    name: str,
    header: str,
    source: str,
    comm: MPI.Intracomm,
    uses: Installed | None = None,
) -> tuple[Any, Any]:
    """Compiled C functions as CFFI's ``lib`` and ``ffi``; collective.

    ``header`` declares the functions.  The compiler options are those of the forms, and the module
    is kept in the cache of the forms.  Its name depends on sources, options and the library
    ``uses``.
    """
    return jit.mpi_jit_decorator(_library)(comm, name, header, source, uses)


def library_of(
    package: str | None,
    name: str,
    comm: MPI.Intracomm,
    uses: Installed | None = None,
    types: str = "",
) -> tuple[Any, Any]:
    """`library` of the files ``name.h`` and ``name.c`` in the folder of a package; collective.

    ``types`` declares types that the files leave open.
    """
    assert package is not None
    folder = resources.files(package)
    header, source = (folder.joinpath(f"{name}.{kind}").read_text("utf-8") for kind in "hc")
    return library(name, types + header, source, comm, uses)


def installed(name: str, header: str) -> Installed | None:
    """The installed library with the header ``include/header``; None if it is not installed."""
    for prefix in dict.fromkeys(map(Path, (sys.prefix, sys.base_prefix, "/usr"))):
        path = prefix / "include" / header
        if path.is_file():
            return Installed(name, prefix, path)
    return None


@functools.cache
def _library(name: str, header: str, source: str, uses: Installed | None) -> tuple[Any, Any]:
    found = jit.get_options(options())
    arguments = [*found[_ARGUMENTS], *_FOR_LIBRARIES]
    cache = Path(found["cache_dir"])
    linked: dict[str, Any] = {}
    made_of = "\n".join([header, source, *arguments])
    if uses is not None:
        linked["libraries"] = [uses.name]
        linked["include_dirs"] = [str(uses.prefix / "include")]
        linked["library_dirs"] = [str(uses.prefix / "lib")]
        # Another version of the library may have another layout of its data.
        made_of += f"{linked}\n{uses.header.read_text(encoding='utf-8')}"
    module = f"libcontact_locking_{name}_{hashlib.sha256(made_of.encode()).hexdigest()[:32]}"
    path = cache / (module + importlib.machinery.EXTENSION_SUFFIXES[0])
    if not path.exists():
        cache.mkdir(parents=True, exist_ok=True)
        # Another process may compile at the same time: only a complete module enters the cache.
        with tempfile.TemporaryDirectory(prefix=module, dir=cache) as folder:
            builder = cffi.FFI()
            builder.cdef(header)
            builder.set_source(module, header + source, extra_compile_args=arguments, **linked)
            Path(builder.compile(tmpdir=folder)).replace(path)
    spec = importlib.util.spec_from_file_location(module, path)
    assert spec is not None and spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded.lib, loaded.ffi


@functools.cache
def options() -> dict[str, Any]:
    """The options of the compiler: ``-O3 -march=native`` unless the user has set other options.

    One more option names the processor.  The name of a compiled form in the cache depends on the
    options, so that different processors may share a cache.  Without information about the
    processor the default options of DOLFINx stay.  The compiler is silent about the generated code,
    which may declare tables that it does not use.

    Every compilation asks for the options, so that the first call also lets forms be kept.
    """
    kept_forms.keep()
    default, _ = jit.DOLFINX_DEFAULT_JIT_OPTIONS[_ARGUMENTS]
    instructions = _instructions()
    if jit.get_options()[_ARGUMENTS] != default or not instructions:
        return {}
    processor = hashlib.sha256("\n".join(instructions).encode()).hexdigest()[:16]
    return {_ARGUMENTS: ["-O3", "-march=native", "-g0", "-w", f"-DPROCESSOR_{processor}"]}


def _instructions() -> list[str]:
    """The model and instructions of the first processor from Linux; elsewhere empty."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").partition("\n\n")[0].splitlines()
    except OSError:
        return []
    named = ("model", "stepping", "flags", "CPU", "Features", "isa")
    return [line for line in lines if line.startswith(named)]
