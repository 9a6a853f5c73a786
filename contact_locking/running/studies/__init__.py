"""Studies: one file describes many cases, and a `run` of its own solves each of them.

A hash of its parameters names the folder of a case.  Only the processes of the cases import DOLFINx
and MPI.  Names are imported when they are first used, because every command needs the signals of
this package and most need nothing else.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .executor import Plan
    from .runner import Study, finish, run, summary_rows

__all__ = ["Plan", "Study", "finish", "run", "summary_rows"]

_HOME = {"Plan": "executor"} | dict.fromkeys(("Study", "finish", "run", "summary_rows"), "runner")


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)
