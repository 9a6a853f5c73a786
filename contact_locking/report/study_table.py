"""The cases of a study as a table that can be sorted and filtered."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

from contact_locking.results.read import Row, number

from .quantities import QUANTITIES
from .shown import shown

_MAIN = frozenset(quantity.key for quantity in QUANTITIES if quantity.plotted)
_NOT_BETWEEN = ("converged", "case")
_ROW_KIND = {"converged": None, "not run": "waiting"}


@dataclass(frozen=True)
class Column:
    """``kind`` is the class of its cells: a column of kind ``more`` is seen on demand only."""

    name: str
    kind: str | None


@dataclass(frozen=True)
class Cell:
    """``order`` is the number that sorts the cell, ``picture`` the case that the cell links to."""

    text: str
    kind: str | None
    order: str | None
    picture: str | None


@dataclass(frozen=True)
class CaseRow:
    """``kind`` is None for a converged case."""

    kind: str | None
    cells: list[Cell]


@dataclass(frozen=True)
class CaseTable:
    """The columns, and a row for each case."""

    columns: list[Column]
    rows: list[CaseRow]


def cases(rows: Sequence[Row], keys: Sequence[str], linked: Collection[str]) -> CaseTable:
    """All rows; ``keys`` vary, and ``linked`` cases have a picture on the page."""
    # The state, which says whether a case converged, comes first: it is seen on a phone too.
    front = ["state", *keys, "reason"]
    names = dict.fromkeys(name for row in rows for name in row)
    order = [*front, *(name for name in names if name not in (*front, *_NOT_BETWEEN)), "case"]
    kinds = {name: _kind(name, front) for name in order}
    if all(row["state"] == "converged" for row in rows):
        kinds["reason"] = "more"
    if any(row.get("warnings") for row in rows):
        kinds["warnings"] = "why"
    columns = [Column(name, kind) for name, kind in kinds.items()]
    return CaseTable(
        columns,
        [
            CaseRow(
                _ROW_KIND.get(row["state"], "failed"),
                [_cell(row, column, linked) for column in columns],
            )
            for row in rows
        ],
    )


def _kind(name: str, front: Sequence[str]) -> str | None:
    if name == "reason":
        return "why"
    vector = name.rpartition(".")[0] if name[-1:].isdecimal() else ""
    return None if name in front or name == "case" or {name, vector} & _MAIN else "more"


def _cell(row: Row, column: Column, linked: Collection[str]) -> Cell:
    value = row.get(column.name)
    text = json.dumps(value, ensure_ascii=False) if isinstance(value, dict | list) else shown(value)
    if column.name == "reason" and row["state"] == "converged":
        text = ""
    is_link = column.name == "case" and isinstance(value, str) and value in linked
    return Cell(text, column.kind, _order(value), text if is_link else None)


def _order(value: Any) -> str | None:
    """A number as JavaScript reads it; None for anything else."""
    found = number(value)
    if found is None or math.isfinite(found):
        return None if found is None else repr(found)
    return "Infinity" if found > 0 else "-Infinity"
