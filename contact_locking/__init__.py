"""Frictional contact of locking materials on DOLFINx.

    from contact_locking import load, solve
    solution = solve(load("demos/block.yml").parameters)

Names are imported when they are first used: what needs no DOLFINx works without it.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from contact_locking._version import __version__ as __version__

if TYPE_CHECKING:
    from contact_locking.errors import ContactLockingError, InputError, NotConverged
    from contact_locking.output import save, write
    from contact_locking.parameters import Parameters
    from contact_locking.problem import check, solve
    from contact_locking.solution import Solution
    from contact_locking.study_file import from_mapping, load

__all__ = [
    "ContactLockingError",
    "InputError",
    "NotConverged",
    "Parameters",
    "Solution",
    "check",
    "from_mapping",
    "load",
    "save",
    "solve",
    "write",
]

_HOME = {
    "ContactLockingError": "errors",
    "InputError": "errors",
    "NotConverged": "errors",
    "Parameters": "parameters",
    "Solution": "solution",
    "check": "problem",
    "from_mapping": "study_file",
    "load": "study_file",
    "save": "output",
    "solve": "problem",
    "write": "output",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
