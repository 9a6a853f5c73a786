"""The page of a study."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from contact_locking.results.names import PARAMETERS, PICTURE
from contact_locking.results.read import Row, StudyResults
from contact_locking.study_file import source

from .charts import Chart
from .pictures import thumbnail
from .shown import shown
from .study_table import cases
from .templates import render
from .trend_charts import trend_charts
from .trends import Trend, axes, trends, varied

_MOST_PICTURES = 200
_MOST_VALUES = 12


def study_page(study: StudyResults) -> tuple[str, list[Chart]]:
    """The HTML document of a study and its charts. Raises InputError for damaged parameters."""
    name = str(study.folder / PARAMETERS)
    data = source.read(name).data
    what = varied(data, name)
    keys = [*what.zip, *what.vary]
    pictures = _pictures(study, keys)
    found = [trend for axis in axes(what, study.rows) for trend in trends(axis, study.rows)]
    drawn: dict[str, list[tuple[Trend, list[Chart]]]] = {}
    for trend in found:
        drawn.setdefault(trend.axis.key, []).append((trend, trend_charts(trend)))
    html = render(
        "study.html.j2",
        title=shown(data.get("title") or "Study"),
        varied=[(key, _values(key, study.rows)) for key in keys],
        side_by_side=len(what.zip) > 1,
        table=cases(study.rows, keys, pictures),
        trends=list(drawn.items()),
        rates=any(trend.differences for trend in found),
        pictures=pictures,
        most_pictures=_MOST_PICTURES,
        parameter_file=study.parameters,
        **_states(study.rows),
    )
    return html, [chart for trends in drawn.values() for _, charts in trends for chart in charts]


def _states(rows: Sequence[Row]) -> dict[str, Any]:
    count = Counter(row["state"] for row in rows)
    others = [f"{n} {state}" for state, n in sorted(count.items()) if state != "converged"]
    return {
        "total": len(rows),
        "converged": count["converged"],
        "unfinished": count["not run"] > 0,
        "other_states": others,
    }


def _values(key: str, rows: Sequence[Row]) -> list[str]:
    """The values of a key, of many the first and the last."""
    values = list(dict.fromkeys(shown(row.get(key)) for row in rows))
    return values if len(values) <= _MOST_VALUES else [*values[:6], "…", *values[-2:]]


def _pictures(study: StudyResults, keys: Sequence[str]) -> dict[str, tuple[str, str]]:
    """The thumbnail of each case as a data URI, with the values that vary as its label."""
    found: dict[str, tuple[str, str]] = {}
    for row in study.rows:
        folder = study.case_folder(row)
        if folder is None or row["case"] in found or len(found) == _MOST_PICTURES:
            continue
        if (image := thumbnail(folder / PICTURE)) is not None:
            label = ", ".join(f"{name} = {shown(row.get(name))}" for name in keys)
            state = "" if row["state"] == "converged" else f" ({row['state']})"
            found[row["case"]] = (image, f"{label}{state}")
    return found
