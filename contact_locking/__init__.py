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
    from contact_locking.adaptivity import solve, solve_adaptively
    from contact_locking.contact.contact import Contact
    from contact_locking.contact.friction_bound import FrictionBound
    from contact_locking.errors import ContactLockingError, InputError, NotConverged
    from contact_locking.parameters import Parameters
    from contact_locking.results.solution import Solution, StudySolution
    from contact_locking.solving import check, solve_assembled, solve_steps
    from contact_locking.study.assembly import assemble
    from contact_locking.study_file import from_mapping, load
    from contact_locking.writing import save, write

__all__ = [
    "Contact",
    "ContactLockingError",
    "FrictionBound",
    "InputError",
    "NotConverged",
    "Parameters",
    "Solution",
    "StudySolution",
    "assemble",
    "check",
    "from_mapping",
    "load",
    "save",
    "solve",
    "solve_adaptively",
    "solve_assembled",
    "solve_steps",
    "write",
]

_HOME = {
    "Contact": "contact.contact",
    "ContactLockingError": "errors",
    "FrictionBound": "contact.friction_bound",
    "InputError": "errors",
    "NotConverged": "errors",
    "Parameters": "parameters",
    "Solution": "results.solution",
    "StudySolution": "results.solution",
    "assemble": "study.assembly",
    "check": "solving",
    "from_mapping": "study_file",
    "load": "study_file",
    "save": "writing",
    "solve": "adaptivity",
    "solve_adaptively": "adaptivity",
    "solve_assembled": "solving",
    "solve_steps": "solving",
    "write": "writing",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
