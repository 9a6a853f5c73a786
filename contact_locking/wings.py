"""The seams where the wings theory/, inverse/ and view/ join the core, which runs without them.

A wing is a package beside the core, and the core never imports it.  When it is imported, it adds
functions to the seams below; a seam imports the wings that are installed when it is first used.
"""

from __future__ import annotations

import functools
import importlib.util
import pkgutil
from collections.abc import Callable, Iterator
from typing import Any

from contact_locking.errors import InputError

NAMES = ("theory", "inverse", "view")


class Seam:
    """The functions of one signature that wings add to the core."""

    def __init__(self) -> None:
        self._functions: list[Callable[..., Any]] = []

    def add(self, function: str, when: Callable[..., bool] = lambda *_: True) -> None:
        """Add ``"module:name"``, imported when it is called; None unless ``when`` is true."""
        self._functions.append(
            lambda *args: pkgutil.resolve_name(function)(*args) if when(*args) else None
        )

    def __iter__(self) -> Iterator[Callable[..., Any]]:
        _load()
        return iter(self._functions)


#: ``(SolvedState, Lifting, Extras) -> Proofs``: what is proved, for a certificate; collective.
PROOFS = Seam()
#: ``(ProblemSolver, Outcome) -> Differentiable``: made when somebody asks.
DERIVATIVES = Seam()
#: ``(SolvableStudy) -> Follower | None``: what a study asks for beside its solutions; raises
#: InputError before the first solve; collective.
FOLLOWERS = Seam()
#: ``(StudyProblem) -> None``: raises InputError for what a study cannot ask for; collective.
CHECKS = Seam()
#: ``(summary) -> list[(name, words)]``: what the terminal tells of a result; None tells nothing.
WORDS = Seam()
#: ``(summary) -> list[row]``: a table for the terminal, empty without one.
TABLES = Seam()
#: ``(Solution, folder) -> list[Finding]``: draws into files of a run, and returns findings; raises
#: NoRoom; collective.
PICTURES = Seam()


def require(wing: str, key: str) -> None:
    """Raise InputError for a key whose wing is not installed."""
    if _package(wing) is None:
        raise InputError(f"needs contact_locking.{wing}, which is not installed", key)


def _package(wing: str) -> str | None:
    name = f"{__package__}.{wing}"
    return name if importlib.util.find_spec(name) else None


@functools.cache
def _load() -> None:
    """Import the wings that are installed."""
    for name in filter(None, map(_package, NAMES)):
        importlib.import_module(name)
