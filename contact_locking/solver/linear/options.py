"""PETSc's options: in its database as long as a solver lives, and those that nothing asks for."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from typing import Any

from petsc4py import PETSc

from contact_locking import _compat
from contact_locking.errors import InputError

PREFIX = "contact_locking_"

_NUMBERS = itertools.count(1)

# Galerkin products on one rank, with the transpose written out, take half the time.  Matrices of
# several ranks refuse this way, and PETSc asks for it without a prefix.
_PRODUCTS_ON_ONE_RANK: dict[str, Any] = {"matptap_via": "rap"}

# A name of an option is one word.
_NAME = re.compile(r"[A-Za-z]\w*")
# Names of options that load code, start programs, open windows or connections, or take a file.
_HARMFUL = re.compile(
    r"python|^dll_|library_preload|debug|terminal|popen|machine|saws|(^|_)display$|^x_|draw|_lg_"
    r"|options_file|options_string|file|dirname|_path$|dump|(^|_)(save|load)(_|$)|trajectory"
)
# A view or a monitor takes where to print, and how, or a number.
_REPORTS = re.compile(r"view|monitor|reason|(^|_)(log|info|citations|history)(_|$)")
_PRINTED = re.compile(
    r"(?i:|true|false|yes|no|on|off|[-+]?\d+(\.\d*)?(e[-+]?\d+)?|(ascii)?(:(stdout|stderr)?(:\w*)*)?)"
)


class UserOptions(dict[str, Any]):
    """Options of the user, without prefix; ``used`` are the names that PETSc has asked for."""

    def __init__(self, options: Mapping[str, Any] | None = None) -> None:
        super().__init__(options or {})
        self.used: set[str] = set()

    def unused(self) -> list[str]:
        """The options without effect, with those of the user's own database under the prefix."""
        names = [name for name in self if name not in self.used]
        for name in PETSc.Options(PREFIX).getAll():
            if name not in self and not _compat.petsc_option_used(PREFIX + name):
                names.append(name)
        return names


class InsertedOptions:
    """Options for one solver in PETSc's database, until they are removed.

    They stand under ``prefix`` of this object, which no other solver has.  To be removed only after
    the last solve: levels of multigrid and factorisations ask for theirs when they are set up, and
    again whenever that is repeated.  Options that the user has in the database under the prefix
    that is given (``-contact_locking_...``) win over those of ``overrides``, and those over
    ``defaults``.
    """

    def __init__(
        self,
        defaults: Mapping[str, Any],
        overrides: Mapping[str, Any] | None = None,
        prefix: str = PREFIX,
    ) -> None:
        self.prefix, self._shared = f"solver{next(_NUMBERS)}_{prefix}", prefix
        self._user = overrides if isinstance(overrides, UserOptions) else UserOptions()
        self._of_database = PETSc.Options(prefix).getAll()
        self._ours = {**defaults, **of_prefix(overrides or {}, prefix), **self._of_database}
        database = PETSc.Options(self.prefix)
        for key, value in self._ours.items():
            database.setValue(key, value)
        bare = _PRODUCTS_ON_ONE_RANK if PETSc.COMM_WORLD.size == 1 else {}
        present = PETSc.Options().getAll()
        self._bare = {name: value for name, value in bare.items() if name not in present}
        for name, value in self._bare.items():
            PETSc.Options().setValue(name, value)

    def remove(self) -> None:
        """Take them out again, and remember which were asked for; more than once does no harm."""
        database, part = PETSc.Options(self.prefix), self._shared.removeprefix(PREFIX)
        for key in self._ours:
            if _compat.petsc_option_used(self.prefix + key):
                if key in self._of_database:
                    # To ask for it makes it used.
                    PETSc.Options(self._shared).hasName(key)
                self._user.used |= {name for name in self._user if name.lower() == part + key}
            database.delValue(key)
        for name in self._bare:
            PETSc.Options().delValue(name)
        self._ours, self._bare = {}, {}


def of_prefix(options: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """The options of the user for the solvers under a prefix, without what it adds to PREFIX."""
    part = prefix.removeprefix(PREFIX)
    return {
        name.removeprefix(part).lower(): value
        for name, value in options.items()
        if name.startswith(part)
    }


def require_usable(options: Mapping[str, Any], section: str | None = None) -> None:
    """Raise InputError for the first name that is no word, has our prefix, or may do harm.

    By a harmful option PETSc runs code, or writes or reads a file; a study file may come from
    anybody.  PETSc has no list of its options.  A misspelt one has no effect, and the warning about
    options that PETSc has not used names it after the solve.  ``section`` is the key of the study
    file that holds the options.
    """
    for name, value in options.items():
        key, shown = (f"{section}.{name}", "") if section else (None, f"-{name}: ")
        lower, text = name.lower(), "" if value is None else str(value).strip()
        if name.startswith(PREFIX):
            raise InputError(f"{shown}leave out {PREFIX}, which is put before it anyway", key)
        if not _NAME.fullmatch(name):
            raise InputError(f"{shown}the name of a PETSc option is one word, as in ksp_type", key)
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
