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
    from contact_locking.assembly import assemble
    from contact_locking.contacts import Contact, FrictionBound
    from contact_locking.errors import ContactLockingError, InputError, NotConverged
    from contact_locking.output import save, write
    from contact_locking.parameters import Parameters
    from contact_locking.problem import check, solve, solve_assembled
    from contact_locking.solution import Solution
    from contact_locking.study_file import from_mapping, load

__all__ = [
    "Contact",
    "ContactLockingError",
    "FrictionBound",
    "InputError",
    "NotConverged",
    "Parameters",
    "Solution",
    "assemble",
    "check",
    "from_mapping",
    "load",
    "save",
    "solve",
    "solve_assembled",
    "write",
]

_HOME = {
    "Contact": "contacts",
    "ContactLockingError": "errors",
    "FrictionBound": "contacts",
    "InputError": "errors",
    "NotConverged": "errors",
    "Parameters": "parameters",
    "Solution": "solution",
    "assemble": "assembly",
    "check": "problem",
    "from_mapping": "study_file",
    "load": "study_file",
    "save": "output",
    "solve": "problem",
    "solve_assembled": "problem",
    "write": "output",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
