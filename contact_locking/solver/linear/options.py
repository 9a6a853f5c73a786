"""PETSc's options: in its database as long as a solver lives, and those that nothing asks for."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

from petsc4py import PETSc

from contact_locking import _compat

PREFIX = "contact_locking_"

_NUMBERS = itertools.count(1)

# Galerkin products on one rank, with the transpose written out, take half the time.  Matrices of
# several ranks refuse this way, and PETSc asks for it without a prefix.
_PRODUCTS_ON_ONE_RANK: dict[str, Any] = {"matptap_via": "rap"}


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
