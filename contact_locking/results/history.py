"""history.csv: a row of numbers for each step of a process."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError
from contact_locking.files.csv_file import csv_text, read_own

#: The columns of a step with their numbers; counts are integers.
Row: TypeAlias = Mapping[str, float]


@dataclass
class History:
    """The steps of a process in the order of their times, each with the same columns."""

    rows: list[Row] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows)

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns; empty without a step."""
        return tuple(self.rows[0]) if self.rows else ()

    def column(self, name: str) -> FloatArray:
        """The values of a column, one for each step.  Raises KeyError for an unknown name."""
        if self.rows and name not in self.rows[0]:
            raise KeyError(name)
        return np.array([row[name] for row in self.rows], dtype=float)

    def last(self, name: str) -> float:
        """The value of a column in the last step, 0 before the first step."""
        return self.rows[-1][name] if self.rows else 0.0

    def converged(self) -> History:
        """The steps without one that did not converge."""
        return History([row for row in self.rows if row.get("converged", 1)])

    def text(self) -> str:
        """The table as CSV, numbers with all their digits."""
        return csv_text(self.columns, (row.values() for row in self.rows))


def read_history(text: str, name: str) -> History:
    """The history in the text of the file ``name``.  Raises InputError for another table."""
    columns, rows = read_own(text, name, _number)
    if columns[:2] != ["step", "t"] or len(set(columns)) != len(columns):
        raise InputError(f"{name}:1: is damaged: the columns must begin with step, t")
    return History([dict(zip(columns, row, strict=True)) for row in rows])


def _number(column: str, cell: str) -> float:
    return int(cell) if cell.lstrip("-").isdecimal() else float(cell)


def values_of(text: str, history: History) -> FloatArray:
    """The values (k,) of a column, or of an expression of columns.  Raises InputError."""
    # Scripts have no expressions.
    from contact_locking.expressions import parse

    if text in history.columns:
        return history.column(text)
    names = [name for name in history.columns if name.isidentifier()]
    expression = parse(text, names)
    values = expression.numpy(**{name: history.column(name) for name in names})
    return np.broadcast_to(np.asarray(values, dtype=float), len(history))
