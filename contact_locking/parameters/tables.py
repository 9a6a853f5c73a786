"""Tables of numbers in CSV files, for use in expressions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from keyword import iskeyword

from contact_locking.expressions import CONSTANTS, FUNCTIONS, POSITION, TIME

from .base import Fault, Section, entry
from .values import Text

#: Names that a table may not have.
_TAKEN = {*POSITION, TIME, "s", "inf", *CONSTANTS, *FUNCTIONS}
_MOST_TABLES = 50


class TableParameters(Section):
    """Two columns of a CSV file, interpolated linearly between the rows."""

    file: Text = entry(..., "a CSV file with a row of column names, relative to the study file")
    over: Text = entry(..., "the name of the column with the ascending arguments")
    column: Text = entry(..., "the name of the column with the values")


def name_faults(names: Iterable[str]) -> Iterator[Fault]:
    """The names of tables that expressions cannot use."""
    names = list(names)
    if len(names) > _MOST_TABLES:
        yield Fault((), f"has {len(names)} tables; at most {_MOST_TABLES} are allowed")
    for name in names:
        if not (name.isascii() and name.isidentifier()) or iskeyword(name):
            yield Fault((name,), "is no name for expressions; take letters, digits and _")
        elif name in _TAKEN:
            yield Fault((name,), "is a name that expressions have already; take another")
