"""The page of a study."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from contact_locking._version import __version__
from contact_locking.parameters.study import StudyParameters
from contact_locking.results.names import PARAMETERS, PICTURE
from contact_locking.results.read import Row, StudyResults
from contact_locking.study_file import source

from .charts import Chart, figure
from .markup import Content, Markup, element, formula, key, section, shown
from .page import DESCRIPTION, page
from .pictures import thumbnail
from .quantities import LOAD_UNIT_NOTE
from .run_page import parameters
from .study_table import cases
from .trend_charts import trend_charts
from .trends import Trend, axes, trends, varied

_MOST_PICTURES = 200


def study_page(study: StudyResults) -> tuple[str, list[Chart]]:
    """The HTML document of a study and its charts. Raises InputError for damaged parameters."""
    name = str(study.folder / PARAMETERS)
    data = source.read(name).data
    what = varied(data, name)
    keys = [*what.zip, *what.vary]
    pictures = _pictures(study, keys)
    found = [trend for axis in axes(what, study.rows) for trend in trends(axis, study.rows)]
    drawn = [(trend, trend_charts(trend)) for trend in found]
    html = page(
        shown(data.get("title") or "Study"),
        _verdict(study.rows),
        _varied(what, study.rows),
        cases(study.rows, keys, pictures),
        _trends(drawn),
        _gallery(pictures),
        section("Parameters", parameters(study.parameters, opened=False)),
        element("footer", f"{DESCRIPTION}: contact_locking {__version__}"),
    )
    return html, [chart for _, charts in drawn for chart in charts]


def _label(row: Row, keys: Sequence[str]) -> str:
    """What varies, in one line."""
    return ", ".join(f"{name} = {shown(row.get(name))}" for name in keys)


def _verdict(rows: Sequence[Row]) -> Markup:
    count = Counter(row["state"] for row in rows)
    converged = count["converged"]
    if converged == len(rows):
        return element(
            "div", element("strong", f"All {len(rows)} cases converged"), class_="verdict"
        )
    others = ", ".join(f"{n} {state}" for state, n in sorted(count.items()) if state != "converged")
    finished = count["not run"] == 0
    title = f"{converged} of {len(rows)} cases converged" + ("" if finished else ", unfinished")
    return element(
        "div",
        element("strong", title),
        element("p", f"{others}; the table has the reasons."),
        None if finished else element("p", "The same study command goes on with the others."),
        class_="verdict bad" if finished else "verdict wait",
    )


def _varied(study: StudyParameters, rows: Sequence[Row]) -> Markup:
    told = []
    for name in (*study.zip, *study.vary):
        values = list(dict.fromkeys(shown(row.get(name)) for row in rows))
        listed = ", ".join(values if len(values) <= 12 else [*values[:6], "…", *values[-2:]])
        told.append(element("li", key(name), f": {listed}"))
    together = " (those in zip side by side)" if len(study.zip) > 1 else ""
    return element("div", element("p", f"What varies{together}:"), element("ul", told))


def _trends(drawn: Sequence[tuple[Trend, list[Chart]]]) -> Markup:
    if not drawn:
        note = "No key varies over numbers, or too few cases have converged."
        return section("What depends on what", element("p", note, class_="soft"))
    parts: list[Content] = [
        element("p", _how_to_read([trend for trend, _ in drawn]), class_="soft")
    ]
    by_axis: dict[str, list[Markup]] = {}
    for trend, charts in drawn:
        unit = "" if trend.quantity.unit == "1" else f" [{trend.quantity.unit}]"
        caption: list[Content] = [formula(trend.quantity.meaning), unit]
        if len(charts) > 1:
            caption.append(f", and how far it is from {trend.compared}")
        by_axis.setdefault(trend.axis.key, []).append(figure(charts, caption))
    for name, figures in by_axis.items():
        parts.append(element("h3", "Over ", key(name)))
        parts.append(element("div", figures, class_="charts"))
    parts.append(element("p", LOAD_UNIT_NOTE, class_="soft"))
    return section("What depends on what", parts)


def _how_to_read(found: Sequence[Trend]) -> str:
    text = "Only converged cases are drawn; of a vector, its length."
    if any(trend.differences for trend in found):
        text += (
            " A rate is the slope of the line through the logarithms: −1 means that the difference "
            "falls as fast as the parameter grows. Hollow marks are within the tolerance of the "
            "solver and not used for it."
        )
    return text


def _pictures(study: StudyResults, keys: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Thumbnail and label by case."""
    found: dict[str, tuple[str, str]] = {}
    for row in study.rows:
        folder = study.case_folder(row)
        if folder is None or row["case"] in found or len(found) == _MOST_PICTURES:
            continue
        if (image := thumbnail(folder / PICTURE)) is not None:
            state = "" if row["state"] == "converged" else f" ({row['state']})"
            found[row["case"]] = (image, f"{_label(row, keys)}{state}")
    return found


def _gallery(pictures: dict[str, tuple[str, str]]) -> Markup:
    figures = [
        element(
            "figure",
            element("img", src=image, alt=f"Solution for {text}"),
            element("figcaption", text, " ", element("code", f"cases/{name}")),
            id=f"picture-{name}",
        )
        for name, (image, text) in pictures.items()
    ]
    note = f"The first {_MOST_PICTURES}; the folders of the cases have all."
    return section(
        "Pictures",
        element("p", note, class_="soft") if len(figures) == _MOST_PICTURES else None,
        element("div", figures, class_="gallery") if figures else None,
    )
