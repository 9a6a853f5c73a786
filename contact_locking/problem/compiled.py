"""Forms, and functions of C, as compiled code for the processor at hand.

``dolfinx_jit_options.json``, where DOLFINx reads such options, overrides what is set here.
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

_ARGUMENTS = "cffi_extra_compile_args"
# Square roots that have to tell of errors are not vectorised.
_FOR_LIBRARIES = ("-std=c17", "-fno-math-errno")


class Installed(NamedTuple):
    """A library of C that has been found: its name, where it is installed, and its header."""

    name: str
    prefix: Path
    header: Path


def form(integrals: Any) -> fem.Form:
    """A UFL form, compiled."""
    return fem.form(integrals, jit_options=options())


def library(
    name: str,
    header: str,
    source: str,
    comm: MPI.Intracomm,
    uses: Installed | None = None,
) -> tuple[Any, Any]:
    """Functions of C, as CFFI's ``lib``, and its ``ffi``; collective.

    ``header`` declares them.  They are kept in the cache of the forms, under a name that depends on
    all that they are made of, and compiled with the same options.
    """
    return jit.mpi_jit_decorator(_library)(comm, name, header, source, uses)


def library_of(
    package: str | None, name: str, comm: MPI.Intracomm, uses: Installed | None = None
) -> tuple[Any, Any]:
    """The same for ``name.h`` and ``name.c`` beside the modules of a package; collective."""
    assert package is not None
    folder = resources.files(package)
    header, source = (folder.joinpath(f"{name}.{kind}").read_text("utf-8") for kind in "hc")
    return library(name, header, source, comm, uses)


def installed(name: str, header: str) -> Installed | None:
    """The library whose header stands at ``include/header``, if there is one."""
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
        # Another version may lay out its data in another way.
        made_of += f"{linked}\n{uses.header.read_text(encoding='utf-8')}"
    module = f"libcontact_locking_{name}_{hashlib.sha256(made_of.encode()).hexdigest()[:32]}"
    path = cache / (module + importlib.machinery.EXTENSION_SUFFIXES[0])
    if not path.exists():
        cache.mkdir(parents=True, exist_ok=True)
        # Another process may be at it, too: what is in the cache is complete.
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
