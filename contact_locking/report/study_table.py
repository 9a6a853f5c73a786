"""The cases of a study as a table that can be sorted and filtered."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Sequence

from contact_locking.results.read import Row, number

from .markup import Content, Markup, element, key, section, shown
from .quantities import QUANTITIES

_MAIN = frozenset(quantity.key for quantity in QUANTITIES if quantity.plotted)
_NOT_BETWEEN = ("converged", "case")
_ROW_CLASS = {"converged": None, "not run": "waiting"}


def cases(rows: Sequence[Row], keys: Sequence[str], linked: Collection[str]) -> Markup:
    """All rows; ``keys`` are what varies, ``linked`` the cases that have a picture on the page."""
    return section("Cases", _tools(), _table(rows, keys, linked))


def _tools() -> Markup:
    search = element(
        "input",
        type="search",
        id="filter",
        placeholder="filter, such as: 0.3 failed",
        aria_label="Show the rows with all of these words",
    )
    every = element("label", element("input", type="checkbox", id="all-columns"), " all columns")
    count = element("span", id="count", class_="soft", role="status")
    return element("div", search, every, count, class_="tools")


def _table(rows: Sequence[Row], keys: Sequence[str], linked: Collection[str]) -> Markup:
    # The state, which says whether a case converged, is seen on a phone too.
    front = ["state", *keys, "reason"]
    names = dict.fromkeys(name for row in rows for name in row)
    columns = [*front, *(name for name in names if name not in (*front, *_NOT_BETWEEN)), "case"]
    kinds = {name: _kind(name, front) for name in columns}
    if all(row["state"] == "converged" for row in rows):
        kinds["reason"] = "more"
    if any(row.get("warnings") for row in rows):
        kinds["warnings"] = "why"
    head = [
        element("th", element("button", key(name), type="button"), scope="col", class_=kind)
        for name, kind in kinds.items()
    ]
    body = [
        element(
            "tr",
            [_cell(row, name, kind, linked) for name, kind in kinds.items()],
            id=f"case-{index}",
            class_=_ROW_CLASS.get(row["state"], "failed"),
        )
        for index, row in enumerate(rows, start=1)
    ]
    parts = (element("thead", element("tr", head)), element("tbody", body))
    whole = element("table", parts, id="cases", class_="main")
    return element("div", whole, class_="scroll cases", tabindex="0")


def _kind(name: str, front: Sequence[str]) -> str | None:
    """The class of a column; ``more`` is seen on demand only."""
    if name == "reason":
        return "why"
    vector = name.rpartition(".")[0] if name[-1:].isdecimal() else ""
    return None if name in front or name == "case" or {name, vector} & _MAIN else "more"


def _cell(row: Row, name: str, kind: str | None, linked: Collection[str]) -> Markup:
    value = row.get(name)
    content: Content = shown(value)
    if isinstance(value, dict | list):
        content = json.dumps(value, ensure_ascii=False)
    elif name == "reason" and row["state"] == "converged":
        content = None
    elif name == "case" and isinstance(value, str) and value in linked:
        content = element("a", element("code", value), href=f"#picture-{value}")
    found = number(value)
    data = None
    if found is not None:
        infinity = "Infinity" if found > 0 else "-Infinity"
        data = repr(found) if math.isfinite(found) else infinity
    return element("td", content, class_=kind, data_value=data)
