"""The page of a study."""

from __future__ import annotations

import json
import re
import textwrap
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

from contact_locking.results.in_words import weakest
from contact_locking.results.names import PARAMETERS, PICTURE
from contact_locking.results.quantities import Quantity, look_up, of_result
from contact_locking.results.read import Row, StudyResults, history_in, number
from contact_locking.study_file import source

from .charts import Chart
from .history_charts import Process, wanted_charts
from .pictures import thumbnail
from .templates import render
from .trends import Trend, VariedTexts, axes, differ, trend_charts, trends, varied
from .words import shown, title, titles_in

_NOT_BETWEEN = ("converged", "case", "reason", "suggestion", "warnings")
_ROW_KIND = {"converged": None, "not run": "waiting"}
#: The column with the reason of a failure, the warnings and the weakness of a result.
REMARKS = "remarks"
# The number of characters of a remark that stay where it is folded.
_FOLDED = 46


class Cell(NamedTuple):
    """A cell with its whole text, of which ``folded`` is what a folded cell shows, if it is less.

    ``order`` is the number that sorts the cell, ``picture`` the case that the cell links to.
    The text of a cell ``in_parts``, a list or a mapping, may take several lines.
    """

    text: str
    kind: str | None = None
    order: str | None = None
    picture: str | None = None
    folded: str | None = None
    in_parts: bool = False


class Column(NamedTuple):
    """A column with its name for readers; columns of kind ``more`` are seen on demand only."""

    key: str
    title: str
    kind: str | None


class CaseTable(NamedTuple):
    """The columns, and for each row the class of HTML, the state in one word, and the cells."""

    columns: list[Column]
    rows: list[tuple[str | None, str, list[Cell]]]


def cases(
    rows: Sequence[Row],
    keys: Sequence[str],
    linked: Collection[str],
    texts: VariedTexts,
    quantities: Mapping[str, Quantity],
) -> CaseTable:
    """All rows; ``keys`` vary, and ``linked`` cases have a picture on the page."""
    # The state, which says whether a case converged, comes first: it is seen on a phone too.
    front = ["state", *keys, REMARKS]
    names = dict.fromkeys(name for row in rows for name in row)
    order = [*front, *(name for name in names if name not in (*front, *_NOT_BETWEEN)), "case"]
    columns = [
        Column(name, texts.titles.get(name) or title(name), _kind(name, front, rows, quantities))
        for name in order
    ]
    remarks = [remark(row) for row in rows]
    if not any(remarks):
        columns = [column for column in columns if column.key != REMARKS]
    found = []
    for row, told in zip(rows, remarks, strict=True):
        short = textwrap.shorten(told, _FOLDED, placeholder="…")
        cells = [
            Cell(told, "why", folded=short if short != told else None)
            if column.key == REMARKS
            else _cell(row, column, linked, texts if column.key in keys else None)
            for column in columns
        ]
        state = str(row["state"])
        found.append((_ROW_KIND.get(state, "failed"), state.replace(" ", "-"), cells))
    return CaseTable(columns, found)


def remark(row: Row) -> str:
    """Why a case failed, or the warnings and the weakness of one that converged; often empty."""
    if row.get("converged") is not True:
        return " ".join(filter(None, (shown(row.get("reason") or ""), _text(row, "suggestion"))))
    weak = weakest(row)
    told = [f"rough: {weak.words}"] if weak is not None and weak.is_rough else []
    if warnings := _text(row, "warnings"):
        told.append(f"warning: {warnings}")
    return "; ".join(told)


def _text(row: Row, key: str) -> str:
    value = row.get(key)
    return value if isinstance(value, str) else ""


def _kind(
    name: str, front: Sequence[str], rows: Sequence[Row], quantities: Mapping[str, Quantity]
) -> str | None:
    if name == REMARKS:
        return "why"
    vector = name.rpartition(".")[0] if name[-1:].isdecimal() else ""
    if name in front or name == "case":
        return None
    found = quantities.get(name) or quantities.get(vector)
    is_main = found is not None and found.trend is not None and found.of != "solver"
    return None if is_main and _tells_apart(name, rows) else "more"


def _tells_apart(name: str, rows: Sequence[Row]) -> bool:
    """Whether a number differs between the cases by more than rounding."""
    values = [number(row.get(name)) for row in rows if row.get("converged") is True]
    known = [value for value in values if value is not None]
    return len(known) > 1 and (len(known) < len(values) or differ(known))


def _cell(row: Row, column: Column, linked: Collection[str], texts: VariedTexts | None) -> Cell:
    """The cell of a column; ``texts`` are those of a key that varies."""
    value = row.get(column.key)
    in_parts = isinstance(value, dict | list)
    if texts is not None:
        return Cell(texts.of(column.key, row), order=_order(value), in_parts=in_parts)
    text = json.dumps(value, ensure_ascii=False) if in_parts else shown(value)
    is_link = column.key == "case" and isinstance(value, str) and value in linked
    return Cell(text, column.kind, _order(value), text if is_link else None)


def _order(value: Any) -> str | None:
    order = number(value)
    # JavaScript reads numbers as Python writes them, but for infinity.
    return None if order is None else repr(order).replace("inf", "Infinity")


_MOST_PICTURES = 200
_MOST_VALUES = 12


def study_page(study: StudyResults) -> tuple[str, list[Chart]]:
    """The HTML document of a study and its charts. Raises InputError for damaged parameters."""
    name = str(study.folder / PARAMETERS)
    data = source.read(name).data
    what = varied(data, name)
    keys = [*what.zip, *what.vary]
    texts = VariedTexts(study.rows, titles_in(keys, data))
    pictures = _pictures(study, keys, texts)
    contacts, units = _contact_names(study.rows), _labels_of_units(study.rows)
    quantities = of_result(contacts, units)
    wanted = look_up(data, "output.charts") or []
    over_steps = wanted_charts(
        wanted,
        _processes(study, keys, texts),
        ", ".join(texts.titles[key] for key in keys),
        contacts,
        units,
    )
    found = [
        trend
        for axis in axes(what, study.rows, texts.titles)
        for trend in trends(axis, study.rows, texts, quantities)
    ]
    drawn = [(trend, trend_charts(trend)) for trend in found]
    over: dict[str, list[tuple[Trend, list[Chart]]]] = {}
    for trend, charts in drawn:
        if trend.quantity.of != "solver":
            over.setdefault(trend.axis.title, []).append((trend, charts))
    html = render(
        "study.html.j2",
        title=shown(data.get("title") or "Study"),
        varied=[(texts.titles[key], key, _values(texts.all_of(key))) for key in keys],
        rough=sum(_is_rough(row) for row in study.rows),
        side_by_side=len(what.zip) > 1,
        table=cases(study.rows, keys, pictures, texts, quantities),
        over_steps=over_steps,
        trends=list(over.items()),
        internals=[pair for pair in drawn if pair[0].quantity.of == "solver"],
        rates=any(trend.differences for trend in found),
        pictures=pictures,
        most_pictures=_MOST_PICTURES,
        parameter_file=study.parameters,
        **_states(study.rows),
    )
    return html, [*over_steps, *(chart for _, charts in drawn for chart in charts)]


def _contact_names(rows: Sequence[Row]) -> list[str]:
    """The names of the contacts if the cases have several, by the columns of their table."""
    found = (re.fullmatch(r"contacts\.([^.]+)\.name", name) for row in rows for name in row)
    return list(dict.fromkeys(one[1] for one in found if one))


def _labels_of_units(rows: Sequence[Row]) -> dict[str, str]:
    """The labels of units, which are those of all cases."""
    row: Row = next((row for row in rows if row.get("units.length")), {})
    return {k.removeprefix("units."): str(row[k]) for k in row if k.startswith("units.")}


def _processes(study: StudyResults, keys: Sequence[str], texts: VariedTexts) -> list[Process]:
    """The steps of each case, with the values that vary."""
    found = []
    for row in study.rows:
        folder = study.case_folder(row)
        history = None if folder is None else history_in(folder)
        if history is not None:
            values = [texts.of(key, row) for key in keys]
            pairs = zip(keys, values, strict=True)
            label = ", ".join(f"{texts.titles[key]} = {text}" for key, text in pairs)
            found.append(Process(history, label, ", ".join(values)))
    return found


def _states(rows: Sequence[Row]) -> dict[str, Any]:
    count = Counter(row["state"] for row in rows)
    others = [f"{n} {state}" for state, n in sorted(count.items()) if state != "converged"]
    return {
        "total": len(rows),
        "converged": count["converged"],
        "unfinished": count["not run"] > 0,
        "other_states": others,
    }


def _is_rough(row: Row) -> bool:
    weak = weakest(row)
    return row.get("converged") is True and weak is not None and weak.is_rough


def _values(texts: list[str]) -> list[str]:
    return texts if len(texts) <= _MOST_VALUES else [*texts[:6], "…", *texts[-2:]]


def _pictures(
    study: StudyResults, keys: Sequence[str], texts: VariedTexts
) -> dict[str, tuple[str, str]]:
    """The thumbnail of each case as a data URI, with the values that vary as its label."""
    found: dict[str, tuple[str, str]] = {}
    for row in study.rows:
        folder = study.case_folder(row)
        if folder is None or row["case"] in found or len(found) == _MOST_PICTURES:
            continue
        if (image := thumbnail(folder / PICTURE)) is not None:
            label = ", ".join(f"{texts.titles[key]} = {texts.of(key, row)}" for key in keys)
            state = "" if row["state"] == "converged" else f" ({row['state']})"
            found[row["case"]] = (image, f"{label}{state}")
    return found
