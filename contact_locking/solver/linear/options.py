"""PETSc's options: in its database as long as a solver lives, and those that nothing asks for."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from petsc4py import PETSc

from contact_locking import _compat
from contact_locking.errors import InputError
from contact_locking.plain_text import nearest

PREFIX = "contact_locking_"

# An option as PETSc's library holds it: "-ksp_type", "-pc_fieldsplit_%d_fields".
_NAME = re.compile(rb"-([A-Za-z]\w*(?:%[ds]\w*)*)\0")
# What can stand inside a solver, under a prefix of its own.
_CLASSES = ("ksp", "pc", "mat", "vec", "snes")
# Names of options that load code, start programs, open windows or connections, or take a file.
_HARMFUL = re.compile(
    r"python|^dll_|library_preload|debug|terminal|popen|machine|saws|(^|_)display$|^x_|draw|_lg_"
    r"|options_file|options_string|file|dirname|_path$|dump|(^|_)(save|load)(_|$)|trajectory"
)
# What a view or a monitor may be given: where to print, and how, or a number.
_REPORTS = re.compile(r"view|monitor|reason|(^|_)(log|info|citations|history)(_|$)")
_PRINTED = re.compile(
    r"(?i:|true|false|yes|no|on|off|[-+]?\d+(\.\d*)?(e[-+]?\d+)?|(ascii)?(:(stdout|stderr)?(:\w*)*)?)"
)
_MAPPED = re.compile(r"/\S*libpetsc\S*")


class UserOptions(dict[str, Any]):
    """Options of the user, without prefix; ``used`` are the names that PETSc has asked for."""

    def __init__(self, options: Mapping[str, Any] | None = None) -> None:
        super().__init__(options or {})
        self.used: set[str] = set()

    def unused(self) -> list[str]:
        """What had no effect, with what the user's own database has under the prefix."""
        names = [name for name in self if name not in self.used]
        for name in PETSc.Options(PREFIX).getAll():
            if name not in self and not _compat.petsc_option_used(PREFIX + name):
                names.append(name)
        return names


class InsertedOptions:
    """Options under a prefix in PETSc's database, until they are removed.

    To be removed only after the last solve: levels of multigrid and factorisations ask for theirs
    when they are set up, and again whenever that is repeated.  What the user already has in the
    database (``-contact_locking_...``) wins over ``overrides``, and those over ``defaults``.
    ``bare`` are those that PETSc asks for without a prefix.
    """

    def __init__(
        self,
        defaults: Mapping[str, Any],
        overrides: Mapping[str, Any] | None = None,
        prefix: str = PREFIX,
        bare: Mapping[str, Any] | None = None,
    ) -> None:
        self._prefix, self._ours = prefix, list[str]()
        self._bare = InsertedOptions(bare, prefix="") if bare else None
        self._user = overrides if isinstance(overrides, UserOptions) else UserOptions()
        database = PETSc.Options(prefix)
        for key, value in {**defaults, **(overrides or {})}.items():
            if not database.hasName(key):
                database.setValue(key, value)
                self._ours.append(key)

    def remove(self) -> None:
        """Take them out again, and remember which were asked for; more than once does no harm."""
        database = PETSc.Options(self._prefix)
        for key in self._ours:
            if key in self._user and _compat.petsc_option_used(self._prefix + key):
                self._user.used.add(key)
            database.delValue(key)
        self._ours = []
        if self._bare is not None:
            self._bare.remove()


def require_known(names: Iterable[str], section: str | None = None) -> None:
    """Raise InputError for the first name that no object of PETSc can ask for, or has our prefix.

    PETSc ignores what it does not know, so that a misspelt option would have no effect unseen.  It
    has no list of its options, but its library holds each as text; objects inside others put their
    prefixes before it, as in ``mg_levels_ksp_type``.  Where the library cannot be read no other is
    refused.  ``section`` is the key of the study file that holds the names.
    """
    known = _library()
    for name in names:
        key = None if section is None else f"{section}.{name}"
        shown = "" if section else f"-{name}: "
        if name.startswith(PREFIX):
            raise InputError(f"{shown}leave out {PREFIX}, which is put before it anyway", key)
        if known and not _is_known(name.lower(), known):
            raise InputError(f"{shown}PETSc has no such option{_guess(name, known)}", key)


def require_harmless(options: Mapping[str, Any], section: str | None = None) -> None:
    """Raise InputError for the first option by which PETSc runs code, or writes or reads a file.

    A study file may come from anybody.  ``section`` is the key of the study file that holds them.
    """
    for name, value in options.items():
        key, shown = (f"{section}.{name}", "") if section else (None, f"-{name}: ")
        lower, text = name.lower(), "" if value is None else str(value).strip()
        # "python" as a type imports a module, and a colon stands before the name of a file.
        if _HARMFUL.search(lower) or text.lower().startswith("python"):
            raise InputError(
                f"{shown}options by which PETSc runs code, opens windows or connections, or takes "
                "files are refused, as study files may come from anybody",
                key,
            )
        if not _PRINTED.fullmatch(text) and (_REPORTS.search(lower) or ":" in text):
            raise InputError(
                f"{shown}{text!r} may be a file, which is refused as study files may come from "
                "anybody; without a value, or with ascii::ascii_info_detail and its like, PETSc "
                "prints to standard output",
                key,
            )


def _is_known(name: str, known: frozenset[str]) -> bool:
    """Whether the name, or what follows a prefix in it, is one of PETSc's."""
    if name in known or any(pattern.fullmatch(name) for pattern in _patterns()):
        return True
    return any(ending in known for ending in _inner(name))


def _inner(name: str) -> list[str]:
    """What an object inside another would ask for."""
    words = name.split("_")
    return ["_".join(words[start:]) for start, word in enumerate(words) if word in _CLASSES]


def _guess(name: str, known: frozenset[str]) -> str:
    ending = [name, *_inner(name)][-1]
    guess = nearest(ending, sorted(known))
    return guess.replace(" '", f" '{name.removesuffix(ending)}")


@cache
def _library() -> frozenset[str]:
    """The names of options in the libraries of PETSc and petsc4py; none if they are not found."""
    try:
        mapped = set(_MAPPED.findall(Path("/proc/self/maps").read_text(encoding="utf-8")))
        contents = [Path(path).read_bytes() for path in sorted({*mapped, PETSc.__file__})]
    except OSError:
        return frozenset()
    names = {name.decode().lower() for content in contents for name in _NAME.findall(content)}
    # Not found in an unknown kind of library.
    return frozenset(names) if "ksp_type" in names else frozenset()


@cache
def _patterns() -> tuple[re.Pattern[str], ...]:
    """Names with a number or a word in them."""
    names = [name for name in _library() if "%" in name and "_" in name.partition("%")[0]]
    words = [name.replace("%d", r"\d+").replace("%s", r"\w+") for name in names]
    return tuple(re.compile(rf"(?:\w+_)?{word}") for word in words)
