"""Tables of named columns in memory, CSV and NPZ: contact points, probes, histories, studies."""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import InputError

#: The columns of one row; counts are integers.
Row: TypeAlias = Mapping[str, Any]


@dataclass
class Table:
    """Columns by name, each of k numbers or words: lists, or arrays (k,).

    ``units`` are those of columns, such as ``length`` and ``stress``; the others have none.
    """

    columns: dict[str, Any] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, rows: Sequence[Row]) -> Table:
        """The table of rows with the columns of the first."""
        return cls({name: [row[name] for row in rows] for name in (rows[0] if rows else ())})

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows)

    @property
    def rows(self) -> list[Row]:
        cells = zip(*self.columns.values(), strict=True)
        return [dict(zip(self.columns, row, strict=True)) for row in cells]

    def append(self, row: Row) -> None:
        """Add a row with the same columns."""
        for name, value in row.items():
            self.columns.setdefault(name, []).append(value)

    def after(self, before: Table) -> Table:
        """The rows of ``before``, a table with the same columns, followed by these."""
        if not before.columns or not self.columns:
            return self if self.columns else before
        pairs = ((name, (before.columns[name], values)) for name, values in self.columns.items())
        return Table({name: np.concatenate(both) for name, both in pairs}, self.units)

    def column(self, name: str) -> FloatArray:
        """The numbers (k,) of a column, empty before the first row.  Raises KeyError."""
        return np.array(self.columns[name] if self.columns else [], dtype=float)

    def whole(self, name: str) -> IntArray:
        """The integers (k,) of a column.  Raises KeyError, and TypeError for other numbers."""
        return np.array(self.columns[name]).astype(np.int64, casting="safe")

    def last(self, name: str) -> Any:
        """The value of a column in the last row, 0 before the first row."""
        return self.columns[name][-1] if self.columns else 0.0

    def converged(self) -> Table:
        """The history without steps that did not converge."""
        return Table.of([row for row in self if row.get("converged", 1)])

    def values(self, text: str) -> FloatArray:
        """The values (k,) of a column, or of an expression of columns.  Raises InputError."""
        # Scripts have no expressions.
        from contact_locking.expressions import parse

        if text in self.columns:
            return self.column(text)
        names = [name for name in self.columns if name.isidentifier()]
        values = parse(text, names).numpy(**{name: self.column(name) for name in names})
        return np.broadcast_to(np.asarray(values, dtype=float), len(self))

    def text(self) -> str:
        """The table as CSV, numbers with all their digits."""
        lists = [x.tolist() if isinstance(x, np.ndarray) else x for x in self.columns.values()]
        stream = io.StringIO()
        csv.writer(stream, lineterminator="\n").writerows(
            [list(self.columns), *zip(*lists, strict=True)]
        )
        return stream.getvalue()

    def save(self, path: str | Path) -> None:
        """Write the columns as arrays of NumPy, their units as ``units``.  Raises OSError."""
        units = np.array([self.units.get(name, "1") for name in self.columns])
        arrays: Any = {name: np.asarray(values) for name, values in self.columns.items()}
        np.savez(path, units=units, **arrays)

    @classmethod
    def read(cls, text: str, name: str, words: Collection[str] = ()) -> Table:
        """The table in the text of the file ``name``, whose columns ``words`` are no numbers.

        Raises InputError, with the line, for a text that is no table.
        """
        reader = csv.reader(io.StringIO(text, newline=""))
        rows: list[Row] = []
        try:
            columns = next(reader, [])
            for cells in reader:
                pairs = zip(columns, cells, strict=True)
                rows.append({key: x if key in words else _number(x) for key, x in pairs})
        except (ValueError, OverflowError, csv.Error):
            message = f"is damaged: no row of {len(columns)} numbers"
            raise InputError(f"{name}:{reader.line_num}: {message}") from None
        if not columns or len(set(columns)) < len(columns):
            raise InputError(f"{name}: is empty or damaged; solve the run again")
        nothing = np.empty(0, dtype=np.int64)
        return cls.of(rows) if rows else cls(dict.fromkeys(columns, nothing))


def _number(cell: str) -> float:
    return int(cell) if cell.lstrip("-").isdecimal() else float(cell)
