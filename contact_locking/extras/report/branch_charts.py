"""The bifurcation diagram of a run: contact pressure and friction bound along a branch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from matplotlib.figure import Figure

from contact_locking.extras.pictures import style
from contact_locking.results.read import number

from .charts import Chart, chart

_ROWS = (("pressure", r"$\int p$"), ("bound", r"$\int G$"))


def branch_charts(summary: Mapping[str, Any]) -> list[Chart]:
    """The chart of the entry ``branches``; none without points that can be read."""
    found = summary.get("branches")
    found = found if isinstance(found, dict) else {}
    points = found.get("points")
    names = ("share", "index", "fold", *(name for name, _ in _ROWS))
    columns = {name: points.get(name) for name in names} if isinstance(points, dict) else {}
    read = {
        name: [number(value) for value in values]
        for name, values in columns.items()
        if isinstance(values, list)
    }
    if len(read) < len(names):
        return []
    whole = all(value is not None for values in read.values() for value in values)
    if not whole or len({len(values) for values in read.values()}) != 1 or not read["share"]:
        return []
    over = str(found.get("over"))
    about = f"Total pressure and total friction bound of the solutions over the share of {over}"
    return [chart("branches", about, 4.2, partial(_draw, columns=read, over=over))]


def _draw(figure: Figure, columns: Mapping[str, Sequence[Any]], over: str) -> None:
    above, below = figure.subplots(2, 1, sharex=True)
    shares = columns["share"]
    for axes, (name, label) in zip((above, below), _ROWS, strict=True):
        values = columns[name]
        axes.plot(shares, values, color=style.GREY, lw=1.0)
        for index, colour, words in (
            (1, style.BLUE, "index +1"),
            (-1, style.VERMILION, "index -1"),
        ):
            own = [place for place, found in enumerate(columns["index"]) if found == index]
            places = [shares[i] for i in own], [values[i] for i in own]
            axes.plot(*places, "o", color=colour, ms=3.0, label=words)
        folds = [place for place, found in enumerate(columns["fold"]) if found]
        places = [shares[i] for i in folds], [values[i] for i in folds]
        axes.plot(*places, "s", color=style.BLACK, ms=4.5, mfc="none", label="fold")
        axes.set_ylabel(label)
    below.set_xlabel(f"share of {over}", loc="left")
    above.legend(loc="best")
