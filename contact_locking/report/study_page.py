"""The page of a study."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from contact_locking.results.names import PARAMETERS, PICTURE
from contact_locking.results.read import Row, StudyResults, number
from contact_locking.study_file import source

from .charts import Chart
from .pictures import thumbnail
from .shown import shown
from .study_table import cases, weakness
from .templates import render
from .titles import titles_in
from .trend_charts import trend_charts
from .trends import Trend, axes, trends, varied
from .varied_texts import VariedTexts

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
    found = [
        trend
        for axis in axes(what, study.rows, texts.titles)
        for trend in trends(axis, study.rows, texts)
    ]
    drawn = [(trend, trend_charts(trend)) for trend in found]
    over: dict[str, list[tuple[Trend, list[Chart]]]] = {}
    for trend, charts in drawn:
        if not trend.quantity.internal:
            over.setdefault(trend.axis.title, []).append((trend, charts))
    html = render(
        "study.html.j2",
        title=shown(data.get("title") or "Study"),
        varied=[(texts.titles[key], key, _values(texts.all_of(key))) for key in keys],
        example=_example(keys, study.rows),
        rough=sum(_is_rough(row) for row in study.rows),
        side_by_side=len(what.zip) > 1,
        table=cases(study.rows, keys, pictures, texts),
        trends=list(over.items()),
        internals=[pair for pair in drawn if pair[0].quantity.internal],
        rates=any(trend.differences for trend in found),
        pictures=pictures,
        most_pictures=_MOST_PICTURES,
        parameter_file=study.parameters,
        **_states(study.rows),
    )
    return html, [chart for _, charts in drawn for chart in charts]


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
    weak = weakness(row)
    return row.get("converged") is True and weak is not None and weak.is_rough


def _example(keys: Sequence[str], rows: Sequence[Row]) -> str:
    """Numbers of a converged case, which the filter then finds."""
    for row in rows[len(rows) // 4 :]:
        if row.get("converged") is True:
            values = [number(row.get(key)) for key in keys]
            return " ".join(f"{value:g}" for value in values[:2] if value is not None)
    return ""


def _values(texts: list[str]) -> list[str]:
    """The values of a key, of many the first and the last."""
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
