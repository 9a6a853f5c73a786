"""The cases of a study as a table that can be sorted and filtered."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from typing import NamedTuple

from contact_locking.results.read import Row, number

from .quantities import QUANTITIES
from .shown import shown

_MAIN = frozenset(quantity.key for quantity in QUANTITIES if quantity.plotted)
_NOT_BETWEEN = ("converged", "case")
_ROW_KIND = {"converged": None, "not run": "waiting"}


class Cell(NamedTuple):
    """``order`` is the number that sorts the cell, ``picture`` the case that the cell links to."""

    text: str
    kind: str | None
    order: str | None
    picture: str | None


class CaseTable(NamedTuple):
    """The kinds of the columns by name, and the kind and the cells of each row.

    A kind is a class of HTML: columns of kind ``more`` are seen on demand only.
    """

    columns: dict[str, str | None]
    rows: list[tuple[str | None, list[Cell]]]


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
    cells = [[_cell(row, name, kind, linked) for name, kind in kinds.items()] for row in rows]
    row_kinds = [_ROW_KIND.get(row["state"], "failed") for row in rows]
    return CaseTable(kinds, list(zip(row_kinds, cells, strict=True)))


def _kind(name: str, front: Sequence[str]) -> str | None:
    if name == "reason":
        return "why"
    vector = name.rpartition(".")[0] if name[-1:].isdecimal() else ""
    return None if name in front or name == "case" or {name, vector} & _MAIN else "more"


def _cell(row: Row, name: str, kind: str | None, linked: Collection[str]) -> Cell:
    value = row.get(name)
    text = json.dumps(value, ensure_ascii=False) if isinstance(value, dict | list) else shown(value)
    if name == "reason" and row["state"] == "converged":
        text = ""
    is_link = name == "case" and isinstance(value, str) and value in linked
    order = number(value)
    # JavaScript reads numbers as Python writes them, but for infinity.
    return Cell(
        text,
        kind,
        None if order is None else repr(order).replace("inf", "Infinity"),
        text if is_link else None,
    )
