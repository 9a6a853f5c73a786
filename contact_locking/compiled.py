"""Forms as compiled code, for the processor at hand.

``dolfinx_jit_options.json``, where DOLFINx reads such options, overrides what is set here.
"""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path
from typing import Any

from dolfinx import fem, jit

_ARGUMENTS = "cffi_extra_compile_args"


def form(integrals: Any) -> fem.Form:
    """A UFL form, compiled."""
    return fem.form(integrals, jit_options=options())


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
