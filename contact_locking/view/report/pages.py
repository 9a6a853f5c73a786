"""The pages of a run and of a study."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from contact_locking.results.contact_points import STATE_NAMES
from contact_locking.results.in_words import number, weakest
from contact_locking.results.output import PARAMETERS, PICTURE
from contact_locking.results.quantities import Quantity, by_name, look_up, of_result
from contact_locking.study_file import reading as source
from contact_locking.study_file.parameters.study import StudyParameters

from .folders import Row, RunResults, StudyResults, history_in
from .page import Chart, embedded, render, shown, title, titles_in
from .run_charts import (
    Process,
    branch_charts,
    charts_of,
    contact_charts,
    fit_charts,
    history_charts,
)
from .trends import Trend, VariedTexts, axes, differ, trend_charts, trends

# The widths of pictures in pixels, and the number of colours of small ones.
_WIDTH, _THUMBNAIL_WIDTH, _THUMBNAIL_COLOURS = 1400, 480, 256


def run_page(run: RunResults) -> tuple[str, list[Chart]]:
    """The HTML document of a run and its charts."""
    summary = run.summary
    contacts, units = [*by_name(summary.get("contacts", []))], summary.get("units", {})
    charts_asked = look_up(source.read(run.folder / PARAMETERS).data, "output.charts") or []
    parts = certificate(summary)
    holds = [entry["holds"] for section in parts for entry in section.judged.values()]
    of_contacts = contact_charts(run)
    steps = charts_of(charts_asked, [Process(run.history)], contacts, units)
    charts = {
        "steps": steps + history_charts(run.history, contacts, units),
        "fit": [] if run.fit is None else fit_charts(run.fit),
        "branch": branch_charts(summary.get("branches"), units),
    }
    states = np.bincount(run.contact.state, minlength=len(STATE_NAMES))
    html = render(
        "run.html.j2",
        title=shown(summary.get("title") or "Run"),
        run=run,
        summary=summary,
        weakness=weakest(summary),
        picture=None if run.picture is None else embedded(run.picture, _WIDTH),
        numbers=_numbers(summary, units),
        internals=dict(_flat({key: summary[key] for key in _OF_SOLVER if key in summary})),
        contact_names=contacts,
        contact_numbers=_numbers_of_contacts(summary, units),
        states=[f"{n} {name}" for n, name in zip(states, STATE_NAMES, strict=True) if n],
        contact_charts=of_contacts,
        charts=charts,
        derivatives=_derivatives(summary),
        certificate=parts,
        judged=(holds.count(True), holds.count(False)),
        stage_columns=[*dict.fromkeys(itertools.chain(*summary.get("stages", [])))],
    )
    groups = [*charts.values(), *(group for _, group in of_contacts)]
    return html, [*itertools.chain(*groups)]


def _derivatives(summary: Mapping[str, Any]) -> list[tuple[str, str, Any, Any]]:
    """Each result with the number, the derivative and the elasticity, large ones first."""
    return [
        (result, key, entry["derivative"], entry["elasticity"])
        for result, entries in summary.get("sensitivities", {}).items()
        for key, entry in sorted(
            entries.items(), key=lambda pair: -abs(pair[1]["elasticity"] or 0.0)
        )
    ]


class Part(NamedTuple):
    """``judged`` are entries with ``value`` and ``holds``, ``others`` all other values, by name."""

    title: str
    judged: dict[str, Any]
    others: dict[str, Any]


def certificate(summary: Mapping[str, Any]) -> list[Part]:
    """The parts of a summary's certificate that hold anything, whatever their names."""
    sections = []
    for name, section in summary.get("certificate", {}).items():
        judged = {k: v for k, v in section.items() if isinstance(v, dict) and "holds" in v}
        others = {key: entry for key, entry in section.items() if key not in judged}
        sections.append(Part(name.replace("_", " ").capitalize(), judged, dict(_flat(others))))
    return [section for section in sections if section.judged or section.others]


def _flat(value: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """The values of nested mappings under their dotted names."""
    for last, entry in value.items():
        name = f"{above}{last}"
        if isinstance(entry, dict):
            yield from _flat(entry, f"{name}.")
        else:
            yield name, entry


# The keys of a summary about the work of the solver.
_OF_SOLVER = (
    *("cells", "dofs", "discretisation", "penalty", "iterations", "friction_fixed_point"),
    *("residual", "duality_gap", "admissible_load_factor", "wall_seconds"),
)
# A quantity, and its values with their places.
_Numbers = list[tuple[Quantity, list[tuple[Any, Any]]]]


def _numbers(summary: Mapping[str, Any], units: Mapping[str, str]) -> _Numbers:
    several = len(summary.get("contacts", [])) > 1
    numbers = [
        (quantity, [(value, summary.get(f"{key}_at"))])
        for key, quantity in of_result((), units).items()
        if quantity.of != "solver" and (value := look_up(summary, key)) is not None
        # The table of contacts has those of each.
        if not (several and quantity.of == "contact")
    ]
    meaning, force = "resultant of the reactions on the body", units.get("force", "force")
    return numbers + [
        (Quantity(f"reactions.{name}", f"reaction on {name}", meaning, force), [(value, None)])
        for name, value in summary.get("reactions", {}).items()
    ]


def _numbers_of_contacts(summary: Mapping[str, Any], units: Mapping[str, str]) -> _Numbers:
    """Each quantity of contacts with its values for them; empty for one."""
    contacts = summary.get("contacts", [])
    return [
        (quantity, [(contact.get(key), contact.get(f"{key}_at")) for contact in contacts])
        for key, quantity in of_result((), units).items()
        if len(contacts) > 1 and any(key in contact for contact in contacts)
    ]


_MOST_PICTURES = 200


def study_page(study: StudyResults) -> tuple[str, list[Chart]]:
    """The HTML document of a study and its charts."""
    data, rows = source.read(study.folder / PARAMETERS).data, study.rows
    what = StudyParameters.model_validate(data["study"])
    keys = [*what.zip, *what.vary]
    texts = VariedTexts(rows, titles_in(keys, data))
    # The names of the contacts if the cases have several, by the columns of their table.
    named = (re.fullmatch(r"contacts\.([^.]+)\.name", name) for row in rows for name in row)
    contacts = [*dict.fromkeys(keys[1] for keys in named if keys)]
    # The labels of units are those of all cases.
    first: Row = next((row for row in rows if row.get("units.length")), {})
    units = {k.removeprefix("units."): str(first[k]) for k in first if k.startswith("units.")}
    quantities = of_result(contacts, units)
    pictures, processes = dict[str, tuple[str, str]](), list[Process]()
    for row, folder in ((row, study.case_folder(row)) for row in rows):
        label = texts.label(row, keys)
        if folder is not None and (history := history_in(folder)) is not None:
            processes.append(Process(history, label))
        if folder is not None and (folder / PICTURE).is_file() and len(pictures) < _MOST_PICTURES:
            image = embedded(folder / PICTURE, _THUMBNAIL_WIDTH, _THUMBNAIL_COLOURS)
            state = "" if row["state"] == "converged" else f" ({row['state']})"
            pictures.setdefault(row["case"], (image, f"{label}{state}"))
    charts_asked = look_up(data, "output.charts") or []
    over_steps = charts_of(charts_asked, processes, contacts, units)
    drawn = [
        (trend, trend_charts(trend))
        for axis in axes(what, rows, texts.titles)
        for trend in trends(axis, rows, texts, quantities)
    ]
    over: dict[str, list[tuple[Trend, list[Chart]]]] = {}
    for trend, charts in drawn:
        if trend.quantity.of != "solver":
            over.setdefault(trend.axis.title, []).append((trend, charts))
    count = Counter(row["state"] for row in rows)
    rough = [(weak := weakest(row)) and weak.is_rough for row in rows if row.get("converged")]
    html = render(
        "study.html.j2",
        title=shown(data.get("title") or "Study"),
        varied=[(texts.titles[key], key, texts.all_of(key)) for key in keys],
        rough=rough.count(True),
        side_by_side=len(what.zip) > 1,
        table=cases(rows, keys, texts, quantities),
        over_steps=over_steps,
        trends=list(over.items()),
        internals=[pair for pair in drawn if pair[0].quantity.of == "solver"],
        rates=any(trend.differences for trend, _ in drawn),
        pictures=pictures,
        most_pictures=_MOST_PICTURES,
        parameter_file=study.parameters,
        total=len(rows),
        converged=count["converged"],
        unfinished=count["not run"] > 0,
        other_states=[f"{n} {state}" for state, n in sorted(count.items()) if state != "converged"],
    )
    return html, [*over_steps, *(chart for _, charts in drawn for chart in charts)]


_NOT_BETWEEN = ("converged", "case", "failure", "reason", "suggestion", "warnings")
_ROW_KIND = {"converged": None, "not run": "waiting"}
#: The column with the reason of a failure, the warnings and the weakness of a result.
REMARKS = "remarks"


class CaseTable(NamedTuple):
    """The columns with their keys and names, and for each row the class of HTML and the cells."""

    columns: list[tuple[str, str]]
    rows: list[tuple[str | None, list[str]]]


def cases(
    rows: Sequence[Row], keys: Sequence[str], texts: VariedTexts, quantities: Mapping[str, Quantity]
) -> CaseTable:
    """All rows, with the ``keys`` that vary, and the quantities that differ."""
    remarks = [_remark(row) for row in rows]
    # The state, which says whether a case converged, comes first: it is seen on a phone too.
    front = ["state", *keys, *([REMARKS] if any(remarks) else [])]
    names = [name for name in dict.fromkeys(itertools.chain(*rows)) if name not in _NOT_BETWEEN]
    others = [name for name in names if name not in front and _differs(name, rows, quantities)]
    order = [*front, *others, "case"]
    entries = []
    for row, remark in zip(rows, remarks, strict=True):
        shown_texts = {name: shown(row.get(name)) for name in order}
        shown_texts |= dict(zip(keys, texts.of(row, keys), strict=True)) | {REMARKS: remark}
        kind = _ROW_KIND.get(str(row["state"]), "failed")
        entries.append((kind, [shown_texts[name] for name in order]))
    return CaseTable([(name, texts.titles.get(name) or title(name)) for name in order], entries)


def _remark(row: Row) -> str:
    """Why a case failed, or the warnings and the weakness of one that converged; often empty."""
    if not row.get("converged"):
        return " ".join(shown(row[key]) for key in ("reason", "suggestion") if row.get(key))
    weak, warnings = weakest(row), row.get("warnings")
    remarks = [f"rough: {weak.words}"] if weak is not None and weak.is_rough else []
    return "; ".join([*remarks, f"warning: {warnings}"] if warnings else remarks)


def _differs(name: str, rows: Sequence[Row], quantities: Mapping[str, Quantity]) -> bool:
    """Whether a column has a quantity that differs by more than rounding."""
    vector = name.rpartition(".")[0] if name[-1:].isdecimal() else ""
    quantity = quantities.get(name) or quantities.get(vector)
    if quantity is None or quantity.trend is None or quantity.of == "solver":
        return False
    values = [number(row.get(name)) for row in rows if row.get("converged") is True]
    known = [value for value in values if value is not None]
    return len(known) > 1 and (len(known) < len(values) or differ(known))
