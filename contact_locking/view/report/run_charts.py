"""Charts of a run: contacts, history, adapted meshes, derivatives, branches and fits."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from contact_locking.arrays import AXES, FloatArray, IntArray
from contact_locking.errors import with_key
from contact_locking.results.contact_points import ContactPoints
from contact_locking.results.contact_points import curves as ordered
from contact_locking.results.quantities import QUANTITIES, Quantity
from contact_locking.results.table import Table
from contact_locking.view.pictures import plane, style
from contact_locking.view.pictures.style import Units, facets_within, nearest_parts

from .folders import RunResults
from .page import WIDTH, Chart, Curve, chart, drawing, gridded, legend_height, name_curves, plain


def contact_charts(run: RunResults) -> list[tuple[str, list[Chart]]]:
    """The charts of each contact, with the name of the contact if there are several."""
    found = []
    rows, units = run.contact.rows(), run.summary.get("units", {})
    largest = float(run.contact.pressure.max(initial=0.0))
    for number, own in enumerate(rows, start=1):
        points, facets = run.contact[own], facets_within(run.facets, own)
        name = run.summary["contacts"][points.contact[0]]["name"] if len(rows) > 1 else ""
        ending, told = (f"-{number}", f": {name}") if len(rows) > 1 else ("", "")
        charts = [
            chart(f"{stem}{ending}", f"{about}{told}", height, draw, points, facets, units, *more)
            for stem, about, height, draw, *more in _drawings(points, largest)
        ]
        found.append((name, charts))
    return found


def _drawings(contact: ContactPoints, largest: float) -> list[tuple[Any, ...]]:
    """The stems of names, descriptions, heights, functions that draw, and their last arguments.

    ``largest`` is the largest pressure of all contacts.
    """
    if contact.dim == 2:
        along = "along the contact boundary"
        tractions = f"Contact pressure, friction traction and its bound {along}"
        slip = f"Tangential displacement and distance to the foundation {along}"
        return [("tractions", tractions, 3.6, _profile, largest), ("slip", slip, 2.6, _opening)]
    i, j, _ = _frame(contact)
    width, high = np.ptp(contact.x[:, [i, j]], axis=0)
    height = float(np.clip(0.85 * WIDTH * high / (width or 1.0), 2.0, 6.0)) + 0.9
    seen = "seen from the foundation"
    return [
        ("pressure", f"Map of the contact pressure, {seen}", height, _map, False),
        ("friction", f"Map of the friction traction, {seen}", height, _map, True),
        ("states", f"Map of open, sticking and slipping points, {seen}", height, _state_map),
    ]


def _profile(
    figure: Figure, contact: ContactPoints, facets: IntArray, units: Units, largest: float
) -> None:
    axes, strip = figure.subplots(2, 1, height_ratios=(1.0, 0.07))
    plane.draw_tractions(axes, strip, contact, facets, units, largest)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)


def _opening(figure: Figure, contact: ContactPoints, facets: IntArray, units: Units) -> None:
    axes = figure.add_subplot()
    parts = ordered(facets)
    positions, label = plane.abscissa([contact.x[part] for part in parts], units)
    for number, (s, part) in enumerate(zip(positions, parts, strict=True)):
        slip = plane.along(contact.u_tangent[part], contact.x[part], s)
        distance = contact.gap[part] - contact.u_normal[part]
        hidden = "_" if number else ""
        axes.plot(s, slip, color=style.VERMILION, lw=1.6, label=hidden + r"tangential $u_\tau$")
        axes.plot(s, distance, color=style.BLUE, lw=1.8, label=hidden + r"distance $g - u_\nu$")
    axes.axhline(0.0, color=style.GREY, lw=0.7, zorder=0.5)
    axes.margins(x=0.0)
    axes.set_xlabel(label, loc="left")
    axes.set_ylabel(style.labelled("length", "length", units))
    figure.legend(loc="outside upper left", ncols=2)


def _map(
    figure: Figure, contact: ContactPoints, facets: IntArray, units: Units, is_friction: bool
) -> None:
    axes, flat = _map_axes(figure, contact, units)
    values, label = contact.pressure, r"contact pressure $-\sigma_\nu$"
    if is_friction:
        values = np.linalg.norm(contact.traction, axis=1)
        label = r"friction traction $|\sigma_\tau|$"
    colours = axes.tripcolor(
        *flat.T, facets, values, shading="gouraud", cmap="cividis", vmin=0.0, rasterized=True
    )
    axes.margins(0.0)
    label = style.labelled(label, "stress", units)
    figure.colorbar(colours, ax=axes, orientation="horizontal", label=label, aspect=40, pad=0.02)


def _state_map(figure: Figure, contact: ContactPoints, facets: IntArray, units: Units) -> None:
    """A point colours the parts of its facets that are nearest to the point."""
    axes, flat = _map_axes(figure, contact, units)
    shapes, point = nearest_parts(flat, facets)
    look: dict[str, Any] = {"edgecolors": "face", "linewidths": 0.2, "rasterized": True}
    parts = PolyCollection(list(shapes), cmap=style.STATES, **look)
    parts.set_array(contact.state[point])
    parts.set_clim(-0.5, 2.5)
    axes.add_collection(parts)
    axes.autoscale_view()
    axes.margins(0.0)
    figure.legend(handles=style.state_patches(), loc="outside lower center", ncols=3)


# Gamma_C is in a plane if it is thinner than this share of its extent.
_PLANE = 1e-6


def _frame(points: ContactPoints) -> tuple[int, int, bool]:
    """The two axes of a map that shows Gamma_C from the foundation, and whether the second is down.

    The viewer looks against the mean normal, along an axis of coordinates.
    """
    normal, extent = points.normal.mean(axis=0), np.ptp(points.x, axis=0)
    across = int(np.argmax(np.abs(normal)))
    # Beside a tool the normals may point along a plane Gamma_C, of which the map shows all.
    if extent.min() < _PLANE * extent.max():
        across = int(np.argmin(extent))
    i, j = (axis for axis in range(3) if axis != across)
    # The cross product of right and up points at the viewer, as the normal does.
    return i, j, bool(np.cross(np.eye(3)[i], np.eye(3)[j]) @ normal < 0.0)


def _map_axes(figure: Figure, contact: ContactPoints, units: Units) -> tuple[Axes, FloatArray]:
    """The axes of a map, and the points (k, 2) in them."""
    i, j, downwards = _frame(contact)
    x_label, y_label = (style.labelled(f"${AXES[axis]}$", "length", units) for axis in (i, j))
    axes = figure.add_subplot(aspect="equal", xlabel=x_label, ylabel=y_label)
    axes.yaxis.set_inverted(downwards)
    return axes, contact.x[:, [i, j]]


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
    for own, ending in ((name, ""), (stem if axis in AXES else "", f", {axis}")):
        if own in QUANTITIES:
            return Column(f"{QUANTITIES[own].name}{ending}", QUANTITIES[own].unit, QUANTITIES[own])
        for contact in contacts:
            key = own.removesuffix(f"_{contact}")
            if key != own and key in QUANTITIES:
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
    drawn: dict[tuple[str, str], dict[str, str]] = {}
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
        drawn.setdefault((about, quantity.unit), {})[name] = column.title
    drawn["energy", "energy"] = _WORK
    return [
        chart(
            f"history-{_FILES.get(about) or re.sub('[^a-z]+', '-', about)}",
            f"{', '.join(lines.values())} over the time",
            2.4 + 0.1 * len(lines),
            _over_time,
            history,
            style.labelled("" if about == "1" else about, unit, units),
            style.labelled("t", "time", units),
            lines,
        )
        for (about, unit), lines in drawn.items()
    ]


def _over_time(
    figure: Figure, history: Table, label: str, time_label: str, lines: Mapping[str, str]
) -> None:
    axes = figure.add_subplot()
    time = history.column("t")
    for number, (column, name) in enumerate(lines.items()):
        dashes = "-" if number < len(_COLOURS) else "--"
        colour = _COLOURS[number % len(_COLOURS)]
        axes.plot(time, history.column(column), dashes, color=colour, label=name)
    # From zero on, so that rounding in a constant is not seen.
    axes.axhline(0.0, color=style.GREY, lw=0.7, zorder=0.5)
    axes.set(xlabel=time_label, ylabel=label)
    figure.legend(loc="outside upper center", ncols=2, fontsize="small")


@dataclass(frozen=True)
class Process:
    """The steps of a case, whose ``label`` has the values that vary in a study."""

    history: Table
    label: str = ""


def wanted_charts(
    wanted: Sequence[Mapping[str, Any]],
    processes: Sequence[Process],
    contacts: Sequence[str],
    units: Units,
) -> list[Chart]:
    """The charts of ``output.charts``, each with a curve for each process.

    Raises InputError for a column that there is not.
    """
    found = []
    for number, one in enumerate(wanted):
        curves = []
        for process in processes:
            history = process.history.converged()
            if len(history) > 1:
                key = f"output.charts.{number}"
                x, y = (
                    with_key(f"{key}.{axis}", partial(history.values, one[axis])) for axis in "xy"
                )
                curves.append(Curve(process.label, x, y))
        x_label, y_label = (_label(one[axis], contacts, units) for axis in "xy")
        if curves:
            stem = re.sub(r"[^A-Za-z0-9._-]+", "_", f"chart-{number}-{one['y']}-over-{one['x']}")
            height = 3.6 + legend_height(sum(bool(curve.label) for curve in curves))
            about = f"{one['y']} over {one['x']}"
            found.append(chart(stem, about, height, _over_column, curves, x_label, y_label))
    return found


def _label(text: str, contacts: Sequence[str], units: Units) -> str:
    """The label of an axis: of a column, of one with the other sign, or the expression itself."""
    name = text.removeprefix("-").strip()
    if not name.replace("_", "").isalnum():
        return text
    column, sign = column_of(name, contacts), "\N{MINUS SIGN}" if name != text else ""
    return sign + style.labelled(column.title, column.unit, units)


def _over_column(figure: Figure, curves: Sequence[Curve], x_label: str, y_label: str) -> None:
    axes = gridded(figure, plain(x_label), plain(y_label))
    for curve in curves:
        look = drawing(curves, curve.label) | {"ms": 2.5}
        axes.plot(curve.x, curve.y, label=plain(curve.label), **look)
    name_curves(figure)


def adapt_charts(run: RunResults) -> list[Chart]:
    """The charts of a run with adapted meshes; none for other runs."""
    adapt = run.summary.get("adapt", {"meshes": []})
    errors = [(row["dofs"], row["estimate"]) for row in adapt["meshes"] if row["estimate"]]
    if not errors:
        return []
    about = "Relative error over the number of unknowns, for each of the adapted meshes"
    return [chart("adapt-error", about, 3.0, _errors, errors, adapt["tolerance"])]


def _errors(figure: Figure, errors: list[tuple[float, float]], tolerance: float) -> None:
    axes, label = gridded(figure, "unknowns", "relative error"), "estimate, by recovery"
    axes.loglog(*zip(*errors, strict=True), color=style.BLUE, marker="o", ms=4, label=label)
    axes.axhline(tolerance, color=style.GREY, lw=1.0, ls="--", label="tolerance", zorder=0.5)
    axes.legend()


# More bars, charts or curves would be no picture.
_MOST_BARS, _MOST_CHARTS, _MOST_CURVES = 20, 8, 6
_LONGEST = 34


def rows_of_derivatives(summary: Mapping[str, Any]) -> list[tuple[str, str, Any, Any]]:
    """Each result with the number, the derivative and the elasticity, large ones first."""
    return [
        (result, key, entry["derivative"], entry["elasticity"])
        for result, entries in summary.get("sensitivities", {}).items()
        for key, entry in sorted(
            entries.items(), key=lambda item: -abs(item[1]["elasticity"] or 0.0)
        )
    ]


def derivative_charts(rows: Sequence[tuple[str, str, Any, Any]]) -> list[Chart]:
    """Bars of elasticities, the change by 1 % more of each number, for each result that has some.

    ``rows`` are those of :func:`rows_of_derivatives`.
    """
    bars: dict[str, list[tuple[str, float]]] = {}
    for result, key, _, elasticity in rows:
        if elasticity is not None:
            bars.setdefault(result, []).append((key, elasticity))
    return [
        chart(
            f"elasticities-{position}",
            f"What 1 % more of each number does to {result}, in per cent",
            1.0 + 0.3 * min(len(own), _MOST_BARS),
            _bars,
            own[:_MOST_BARS],
        )
        for position, (result, own) in enumerate(list(bars.items())[:_MOST_CHARTS], start=1)
    ]


def _bars(figure: Figure, bars: Sequence[tuple[str, float]]) -> None:
    axes = figure.add_subplot()
    names = [key if len(key) <= _LONGEST else f"…{key[1 - _LONGEST :]}" for key, _ in bars]
    colours = [style.BLUE if value >= 0.0 else style.VERMILION for _, value in bars]
    axes.barh(range(len(bars)), [value for _, value in bars], color=colours, height=0.65)
    axes.set_yticks(range(len(bars)), names)
    axes.invert_yaxis()
    axes.axvline(0.0, color=style.BLACK, lw=0.8)
    axes.set_xlabel("change in % for 1 % more", loc="left")
    axes.margins(x=0.08)


def branch_charts(found: Mapping[str, Any] | None, units: Units) -> list[Chart]:
    """The bifurcation diagram of the entry ``branches``: pressure and friction bound along it."""
    if not found or not found["points"]["share"]:
        return []
    points = {name: np.array(values) for name, values in found["points"].items()}
    over = f"share of {found['over']}"
    about = f"Total pressure and total friction bound of the solutions over the {over}"
    return [chart("branches", about, 4.2, _branch, points, over, units)]


def _branch(figure: Figure, points: Mapping[str, Any], over: str, units: Units) -> None:
    above, below = figure.subplots(2, 1, sharex=True)
    fold: dict[str, Any] = {"marker": "s", "color": style.BLACK, "ms": 4.5, "mfc": "none"}
    marks: list[tuple[Any, str, dict[str, Any]]] = [
        (points["index"] == 1, "index +1", {"marker": "o", "color": style.BLUE, "ms": 3.0}),
        (points["index"] == -1, "index -1", {"marker": "o", "color": style.VERMILION, "ms": 3.0}),
        (points["fold"] == 1, "fold", fold),
    ]
    for axes, name, label in ((above, "pressure", r"$\int p$"), (below, "bound", r"$\int G$")):
        axes.plot(points["share"], points[name], color=style.GREY, lw=1.0)
        for own, words, look in marks:
            axes.plot(points["share"][own], points[name][own], label=words, ls="", **look)
        axes.set_ylabel(style.labelled(label, "force", units))
    below.set_xlabel(over, loc="left")
    above.legend(loc="best")


def fit_chart(fit: Mapping[str, Any]) -> Chart:
    """Data, the model at the numbers that were found, and residuals, for curves of fit.json."""
    curves = fit["curves"][:_MOST_CURVES]
    names = ", ".join(dict.fromkeys(curve["column"] for curve in curves))
    about = f"Measured {names}, the model at the fitted numbers, and the residuals"
    return chart("fit", about, 0.5 + 2.9 * len(curves), _fit, curves)


def _fit(figure: Figure, curves: Sequence[Mapping[str, Any]]) -> None:
    axes = figure.subplots(2 * len(curves), 1, height_ratios=[1.0, 0.35] * len(curves))
    several = len({curve["file"] for curve in curves}) > 1
    for curve, (above, below) in zip(curves, axes.reshape(-1, 2), strict=True):
        _curve(above, below, curve)
        above.set_title(curve["file"] if several else "", loc="left")
    axes[0].legend(loc="best")


def _curve(above: Axes, below: Axes, curve: Mapping[str, Any]) -> None:
    data, model = np.array(curve["data"]), np.array(curve["model"])
    over = np.array(curve["over"] or np.arange(len(data)))
    order = np.argsort(over, kind="stable")
    look: dict[str, Any] = {"color": style.BLACK, "ms": 3.0, "lw": 0.8}
    above.errorbar(over, data, curve["sigma"], fmt="o", label="data", **look)
    above.plot(over[order], model[order], color=style.BLUE, lw=1.8, label="model", zorder=3)
    above.set_ylabel(curve["column"])
    style.power_beside(above)
    above.tick_params(labelbottom=False)
    below.axhline(0.0, color=style.BLUE, lw=1.2)
    below.vlines(over, 0.0, data - model, color=style.GREY, lw=0.8)
    below.plot(over, data - model, "o", color=style.VERMILION, ms=2.5)
    below.set_ylabel("residual")
    below.set_xlabel(curve["along"] or "row", loc="left")
    below.sharex(above)
