"""Charts of the history of a process: forces, areas and work over the time."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from matplotlib.figure import Figure

from contact_locking.arrays import AXES
from contact_locking.plotting import style
from contact_locking.results.history import History

from .charts import Chart, chart

_AREAS = {"contact_area": "contact", "slip_area": "slip"}
_WORK = {
    "work_total": "work of the loads",
    "stored": "stored",
    "dissipated_total": "dissipated by friction",
    "numerical_total": "lost by the method",
}
_COLOURS = (style.BLUE, style.VERMILION, style.BLACK, style.ORANGE)


def history_charts(history: History) -> list[Chart]:
    """The charts of a process; none without two steps."""
    if len(history) < 2:
        return []
    kinds = {"contact_force": "pressure", "friction_force": "friction"}
    forces = {
        f"{kind}_{axis}": f"{name}, {axis}"
        for kind, name in kinds.items()
        for axis in AXES
        if f"{kind}_{axis}" in history.columns
    }
    drawn = {
        "history-forces": ("Resultants on the body over the time", "force", forces),
        "history-areas": ("Area of contact and of slip over the time", "area", _AREAS),
        "history-work": ("Work and energies over the time", "work", _WORK),
    }
    return [
        chart(name, text, 2.6, partial(_curves, history=history, label=label, lines=lines))
        for name, (text, label, lines) in drawn.items()
    ]


def _curves(figure: Figure, history: History, label: str, lines: Mapping[str, str]) -> None:
    axes = figure.add_subplot()
    time = history.column("t")
    for number, (column, name) in enumerate(lines.items()):
        dashes = "-" if number < len(_COLOURS) else "--"
        colour = _COLOURS[number % len(_COLOURS)]
        axes.plot(time, history.column(column), dashes, color=colour, label=name)
    axes.set(xlabel="t", ylabel=label)
    figure.legend(loc="outside upper center", ncols=2, fontsize="small")
