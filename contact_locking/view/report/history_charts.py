"""Charts of the history of a process: over the time, and of any columns over others."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from contact_locking.arrays import AXES
from contact_locking.errors import with_key
from contact_locking.results.history import History
from contact_locking.results.history_values import values_of
from contact_locking.results.quantities import QUANTITIES, Quantity
from contact_locking.view.pictures import style

from .charts import Chart, chart
from .curves import Curve, drawing, has_bar, name_curves, plain

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

    def label(self, units: Mapping[str, str]) -> str:
        """The title with the unit, as far as there is a label for it."""
        return f"{self.title} [{units[self.unit]}]" if self.unit in units else self.title


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


def history_charts(
    history: History, contacts: Sequence[str], units: Mapping[str, str]
) -> list[Chart]:
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
            Column("" if about == "1" else about, unit).label(units),
            Column("t", "time").label(units),
            lines,
        )
        for (about, unit), lines in drawn.items()
    ]


def _over_time(
    figure: Figure, history: History, label: str, time_label: str, lines: Mapping[str, str]
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
    """The steps of a case, whose ``label`` has the ``values`` that vary in a study."""

    history: History
    label: str = ""
    values: str = ""


def wanted_charts(
    wanted: Sequence[Mapping[str, Any]],
    processes: Sequence[Process],
    varied: str,
    contacts: Sequence[str],
    units: Mapping[str, str],
) -> list[Chart]:
    """The charts of ``output.charts``, each with a curve for each process.

    ``varied`` names what the values are of.  Raises InputError for a column that there is not.
    """
    found = []
    for number, one in enumerate(wanted):
        curves = []
        for process in processes:
            history = process.history.converged()
            if len(history) > 1:
                key = f"output.charts.{number}"
                x, y = (
                    with_key(f"{key}.{axis}", partial(values_of, one[axis], history))
                    for axis in "xy"
                )
                curves.append(Curve(process.label, x, y, values=process.values))
        x_label, y_label = (_label(one[axis], contacts, units) for axis in "xy")
        if curves:
            stem = re.sub(r"[^A-Za-z0-9._-]+", "_", f"chart-{number}-{one['y']}-over-{one['x']}")
            rows = 0 if has_bar(curves) else sum(bool(curve.label) for curve in curves)
            about = f"{one['y']} over {one['x']}"
            labels = (x_label, y_label, varied)
            found.append(chart(stem, about, 3.6 + 0.19 * rows, _over_column, curves, *labels))
    return found


def _label(text: str, contacts: Sequence[str], units: Mapping[str, str]) -> str:
    """The label of an axis: of a column, of one with the other sign, or the expression itself."""
    name = text.removeprefix("-").strip()
    if not name.replace("_", "").isalnum():
        return text
    return ("\N{MINUS SIGN}" if name != text else "") + column_of(name, contacts).label(units)


def _over_column(
    figure: Figure, curves: Sequence[Curve], x_label: str, y_label: str, varied: str
) -> None:
    axes = figure.add_subplot()
    for curve in curves:
        axes.plot(curve.x, curve.y, **{**drawing(curves, curve.label), "ms": 2.5})
    axes.set(xlabel=plain(x_label), ylabel=plain(y_label))
    axes.grid(color=style.PALE, lw=0.6)
    axes.set_axisbelow(True)
    name_curves(figure, curves, varied)
