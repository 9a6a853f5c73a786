"""Charts of a run: contacts, history, adapted meshes, derivatives, branches and fits."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from contact_locking.arrays import AXES, IntArray
from contact_locking.errors import with_key
from contact_locking.results.contact_points import ContactPoints
from contact_locking.results.contact_points import curves as ordered
from contact_locking.results.quantities import QUANTITIES, Quantity
from contact_locking.results.table import Table
from contact_locking.view.pictures import plane, style
from contact_locking.view.pictures.style import Units, facets_within

from .folders import RunResults
from .page import Chart, Curve, drawing, drawn, gridded, legend_height, name_curves, plain


def contact_charts(run: RunResults) -> list[tuple[str, list[Chart]]]:
    """The charts of each contact in the plane, with its name if there are several."""
    charts_by_contact: list[tuple[str, list[Chart]]] = []
    if run.contact.dim == 3:
        return charts_by_contact  # the picture shows them
    rows, units = run.contact.rows(), run.summary.get("units", {})
    largest = float(run.contact.pressure.max(initial=0.0))
    for number, in_contact in enumerate(rows, start=1):
        points, facets = run.contact[in_contact], facets_within(run.facets, in_contact)
        name = run.summary["contacts"][points.contact[0]]["name"] if len(rows) > 1 else ""
        ending, of = (f"-{number}", f": {name}") if len(rows) > 1 else ("", "")
        charts: list[Chart] = []
        along = f"along the contact boundary{of}"
        about = f"Contact pressure, friction traction and its bound {along}"
        with drawn(charts, f"tractions{ending}", about, 3.6) as figure:
            axes, strip = figure.subplots(2, 1, height_ratios=(1.0, 0.07))
            plane.draw_tractions(axes, strip, points, facets, units, largest)
            handles = axes.get_legend_handles_labels()
            figure.legend(*handles, loc="outside upper left", ncols=2)
        about = f"Tangential displacement and distance to the foundation {along}"
        with drawn(charts, f"slip{ending}", about, 2.6) as figure:
            _opening(figure, points, facets, units)
        charts_by_contact.append((name, charts))
    return charts_by_contact


def _opening(figure: Figure, contact: ContactPoints, facets: IntArray, units: Units) -> None:
    axes = figure.add_subplot()
    lines = ordered(facets)
    positions, label = plane.abscissa([contact.x[line] for line in lines], units)
    for number, (s, line) in enumerate(zip(positions, lines, strict=True)):
        slip = plane.along(contact.u_tangent[line], contact.x[line], s)
        distance = contact.gap[line] - contact.u_normal[line]
        hidden = "_" if number else ""
        axes.plot(s, slip, color=style.VERMILION, lw=1.6, label=hidden + r"tangential $u_\tau$")
        axes.plot(s, distance, color=style.BLUE, lw=1.8, label=hidden + r"distance $g - u_\nu$")
    axes.axhline(0.0, color=style.GREY, lw=0.7, zorder=0.5)
    axes.margins(x=0.0)
    axes.set_xlabel(label, loc="left")
    axes.set_ylabel(style.labelled("length", "length", units))
    figure.legend(loc="outside upper left", ncols=2)


_WORK = {
    "work_total": "work of the loads",
    "stored": "stored",
    "dissipated_total": "dissipated by friction",
    "numerical_total": "lost by the method",
}
# The words and units of other columns, by the beginnings of their names.
_OTHERS = {
    "reaction": ("reaction on", "force"),
    "tool_force": ("force on the foundation on", "force"),
    "tool_travel": ("travel of", "length"),
    "motion": ("motion of", "length"),
}
_ENERGIES = ("stored", "work", "dissipated", "numerical")
# The names of files for units that are no words.
_FILES = {"1": "strain", "force · length": "moment"}
_COLOURS = (style.BLUE, style.VERMILION, style.BLACK, style.ORANGE)


@dataclass(frozen=True)
class Column:
    """What a column of history.csv is about, in words, and its unit.

    The column of a ``quantity`` of a contact is that of the contact's name, or "" for all.
    """

    title: str
    unit: str = ""
    quantity: Quantity | None = None
    contact: str = ""


def column_of(name: str, contacts: Sequence[str]) -> Column:
    """The column of a name, in the history of a body whose contacts have these names."""
    stem, _, axis = name.rpartition("_")
    for word, ending in ((name, ""), (stem if axis in AXES else "", f", {axis}")):
        if quantity := QUANTITIES.get(word):
            return Column(f"{quantity.name}{ending}", quantity.unit, quantity)
        for contact in contacts:
            key = word.removesuffix(f"_{contact}")
            if key != word and key in QUANTITIES:
                title = f"{QUANTITIES[key].name} on {contact}{ending}"
                return Column(title, QUANTITIES[key].unit, QUANTITIES[key], contact)
    for key, (words, unit) in _OTHERS.items():
        if name.startswith(f"{key}_") or name == key:
            place, _, last = name[len(key) + 1 :].rpartition("_")
            of = f"{place}, {last}" if place and last in AXES else f"{place}_{last}".strip("_")
            return Column(f"{words} {of}", unit)
    unit = "energy" if name.split("_")[0] in _ENERGIES else "time" if name == "t" else ""
    return Column(name.replace("_", " "), unit)


def history_charts(history: Table, contacts: Sequence[str], units: Units) -> list[Chart]:
    """The charts of a process over the time; none without two steps that converged.

    Of several ``contacts`` each has its own curves.
    """
    history, several = history.converged(), len(contacts) > 1
    if len(history) < 2:
        return []
    groups: dict[tuple[str, str], dict[str, str]] = {}
    for name in history.columns:
        column = column_of(name, contacts)
        quantity = column.quantity
        if quantity is None or quantity.detail or not np.isfinite(history.column(name)).any():
            continue
        if quantity.of == "contact" and several and not column.contact:
            continue
        about = "place" if quantity.is_place else quantity.unit
        about = "share" if quantity.share_of else about
        about = quantity.name if several and quantity.is_resultant else about
        groups.setdefault((about, quantity.unit), {})[name] = column.title
    groups["energy", "energy"] = _WORK
    charts: list[Chart] = []
    time, time_label = history.column("t"), style.labelled("t", "time", units)
    for (about, unit), lines in groups.items():
        stem = f"history-{_FILES.get(about) or re.sub('[^a-z]+', '-', about)}"
        words, height = f"{', '.join(lines.values())} over the time", 2.4 + 0.1 * len(lines)
        with drawn(charts, stem, words, height) as figure:
            axes = figure.add_subplot()
            for number, (name, title) in enumerate(lines.items()):
                dashes = "-" if number < len(_COLOURS) else "--"
                colour = _COLOURS[number % len(_COLOURS)]
                axes.plot(time, history.column(name), dashes, color=colour, label=title)
            # From zero on, so that rounding in a constant is not seen.
            axes.axhline(0.0, color=style.GREY, lw=0.7, zorder=0.5)
            label = style.labelled("" if about == "1" else about, unit, units)
            axes.set(xlabel=time_label, ylabel=label)
            figure.legend(loc="outside upper center", ncols=2, fontsize="small")
    return charts


@dataclass(frozen=True)
class Process:
    """The steps of a case, whose ``label`` has the values that vary in a study."""

    history: Table
    label: str = ""


def charts_of(
    entries: Sequence[Mapping[str, Any]],
    processes: Sequence[Process],
    contacts: Sequence[str],
    units: Units,
) -> list[Chart]:
    """The charts of ``output.charts``, each with a curve for each process.

    Raises InputError for a column that there is not.
    """
    charts: list[Chart] = []
    for number, row in enumerate(entries):
        curves = []
        for process in processes:
            history = process.history.converged()
            if len(history) > 1:
                key = f"output.charts.{number}"
                x, y = (
                    with_key(f"{key}.{axis}", partial(history.values, row[axis])) for axis in "xy"
                )
                curves.append(Curve(process.label, x, y))
        x_label, y_label = (_label(row[axis], contacts, units) for axis in "xy")
        if curves:
            stem = re.sub(r"[^A-Za-z0-9._-]+", "_", f"chart-{number}-{row['y']}-over-{row['x']}")
            height = 3.6 + legend_height(sum(bool(curve.label) for curve in curves))
            about = f"{row['y']} over {row['x']}"
            with drawn(charts, stem, about, height) as figure:
                axes = gridded(figure, plain(x_label), plain(y_label))
                for curve in curves:
                    look = drawing(curves, curve.label) | {"ms": 2.5}
                    axes.plot(curve.x, curve.y, label=plain(curve.label), **look)
                name_curves(figure)
    return charts


def _label(text: str, contacts: Sequence[str], units: Units) -> str:
    """The label of an axis: of a column, of one with the other sign, or the expression itself."""
    name = text.removeprefix("-").strip()
    if not name.replace("_", "").isalnum():
        return text
    column, sign = column_of(name, contacts), "\N{MINUS SIGN}" if name != text else ""
    return sign + style.labelled(column.title, column.unit, units)


# More curves would be no picture.
_MOST_CURVES = 6


def branch_charts(diagram: Mapping[str, Any] | None, units: Units) -> list[Chart]:
    """The bifurcation diagram of the entry ``branches``: pressure and friction bound along it."""
    if not diagram or not diagram["points"]["share"]:
        return []
    points = {name: np.array(values) for name, values in diagram["points"].items()}
    over, charts = f"share of {diagram['over']}", list[Chart]()
    about = f"Total pressure and total friction bound of the solutions over the {over}"
    with drawn(charts, "branches", about, 4.2) as figure:
        above, below = figure.subplots(2, 1, sharex=True)
        dot: dict[str, Any] = {"marker": "o", "ms": 3.0}
        marks: list[tuple[Any, str, dict[str, Any]]] = [
            (points["index"] == 1, "index +1", dot | {"color": style.BLUE}),
            (points["index"] == -1, "index -1", dot | {"color": style.VERMILION}),
            (points["fold"] == 1, "fold", {"marker": "s", "color": style.BLACK, "mfc": "none"}),
        ]
        for axes, name, label in ((above, "pressure", r"$\int p$"), (below, "bound", r"$\int G$")):
            axes.plot(points["share"], points[name], color=style.GREY, lw=1.0)
            for rows, words, look in marks:
                look = {"ms": 4.5, "ls": ""} | look
                axes.plot(points["share"][rows], points[name][rows], label=words, **look)
            axes.set_ylabel(style.labelled(label, "force", units))
        below.set_xlabel(over, loc="left")
        above.legend(loc="best")
    return charts


def fit_charts(fit: Mapping[str, Any]) -> list[Chart]:
    """Data, the model at the numbers that were found, and residuals, for curves of fit.json."""
    curves, charts = fit["curves"][:_MOST_CURVES], list[Chart]()
    names = ", ".join(dict.fromkeys(curve["column"] for curve in curves))
    about = f"Measured {names}, the model at the fitted numbers, and the residuals"
    with drawn(charts, "fit", about, 0.5 + 2.9 * len(curves)) as figure:
        pairs = figure.subplots(2 * len(curves), 1, height_ratios=[1.0, 0.35] * len(curves))
        several = len({curve["file"] for curve in curves}) > 1
        for curve, (above, below) in zip(curves, pairs.reshape(-1, 2), strict=True):
            data, model = np.array(curve["data"]), np.array(curve["model"])
            over = np.array(curve["over"] or np.arange(len(data)))
            order = np.argsort(over, kind="stable")
            look: dict[str, Any] = {"color": style.BLACK, "ms": 3.0, "lw": 0.8}
            above.errorbar(over, data, curve["sigma"], fmt="o", label="data", **look)
            line: dict[str, Any] = {"color": style.BLUE, "lw": 1.8, "zorder": 3}
            above.plot(over[order], model[order], label="model", **line)
            above.set_ylabel(curve["column"])
            style.power_beside(above)
            above.tick_params(labelbottom=False)
            above.set_title(curve["file"] if several else "", loc="left")
            below.axhline(0.0, color=style.BLUE, lw=1.2)
            below.vlines(over, 0.0, data - model, color=style.GREY, lw=0.8)
            below.plot(over, data - model, "o", color=style.VERMILION, ms=2.5)
            below.set_ylabel("residual")
            below.set_xlabel(curve["along"] or "row", loc="left")
            below.sharex(above)
        pairs[0].legend(loc="best")
    return charts
