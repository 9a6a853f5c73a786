"""What a process has loaded or built once for FFCx and UFL, for the next form that asks for it.

For every form, also for one that was loaded before, FFCx lists the whole folder of compiled forms
and loads the library again.  Basix builds the cell of an element, with all its sides, each time it
is asked for it, which is hundreds of times per problem.  For small problems this would take more
time than the solve.
"""

from __future__ import annotations

import functools
from typing import Any

import basix.ufl
import ffcx.codegeneration.jit
import ufl


def keep() -> None:
    """Let FFCx and Basix keep what does not change in a process; a second call does nothing.

    A version that has no such functions works as it is.
    """
    compiler, element = ffcx.codegeneration.jit, getattr(basix.ufl, "_ElementBase", None)
    load = getattr(compiler, "get_cached_module", None)
    if load is not None and not hasattr(load, "__wrapped__"):
        compiler.get_cached_module = _loading_once(load)
    if element is not None and isinstance(getattr(element, "cell", None), property):
        element.cell = property(lambda self: _cell(self.cell_type.name))


def _loading_once(load: Any) -> Any:
    """FFCx's search for a compiled form, which then remembers what it has found.

    A form that it has not found is about to be compiled.
    """
    found: dict[tuple[str, ...], Any] = {}

    @functools.wraps(load)
    def loaded(module_name: str, object_names: list[str], cache_dir: Any, timeout: int) -> Any:
        name = (str(cache_dir), module_name, *object_names)
        if name not in found:
            result = load(module_name, object_names, cache_dir, timeout)
            if result[0] is None:
                return result
            found[name] = result
        return found[name]

    return loaded


@functools.cache
def _cell(name: str) -> ufl.Cell:
    return ufl.Cell(name)
