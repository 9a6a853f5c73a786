"""Charts of what a run finds beside its solution: derivatives, a branch of solutions, a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from contact_locking.extras.pictures import style

from .charts import Chart, chart

# More bars, charts or curves would be no picture.
_MOST_BARS, _MOST_CHARTS, _MOST_CURVES = 20, 8, 6
_LONGEST = 34


def rows_of_derivatives(summary: Mapping[str, Any]) -> list[tuple[str, str, Any, Any]]:
    """Each result with the number, the derivative and the elasticity, large ones first."""
    rows: list[tuple[str, str, Any, Any]] = []
    for result, entries in summary.get("sensitivities", {}).items():
        own = [
            (result, key, entry["derivative"], entry["elasticity"])
            for key, entry in entries.items()
        ]
        rows += sorted(own, key=lambda row: -abs(row[3] or 0.0))
    return rows


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
            partial(_bars, bars=own[:_MOST_BARS]),
        )
        for position, (result, own) in enumerate(list(bars.items())[:_MOST_CHARTS], start=1)
    ]


def _bars(figure: Figure, bars: Sequence[tuple[str, float]]) -> None:
    axes = figure.add_subplot()
    names = [key if len(key) <= _LONGEST else f"…{key[1 - _LONGEST :]}" for key, _ in bars]
    values = [value for _, value in bars]
    colours = [style.BLUE if value >= 0.0 else style.VERMILION for value in values]
    places = range(len(bars))
    axes.barh(places, values, color=colours, height=0.65)
    axes.set_yticks(places, names)
    axes.invert_yaxis()
    axes.axvline(0.0, color=style.BLACK, lw=0.8)
    axes.set_xlabel("change in % for 1 % more", loc="left")
    axes.margins(x=0.08)


_ROWS = (("pressure", r"$\int p$"), ("bound", r"$\int G$"))


def branch_charts(found: Mapping[str, Any] | None) -> list[Chart]:
    """The bifurcation diagram of the entry ``branches``: pressure and friction bound along it."""
    if not found or not found["points"]["share"]:
        return []
    points = {name: np.array(values) for name, values in found["points"].items()}
    over = f"share of {found['over']}"
    about = f"Total pressure and total friction bound of the solutions over the {over}"
    return [chart("branches", about, 4.2, partial(_branch, points=points, over=over))]


def _branch(figure: Figure, points: Mapping[str, Any], over: str) -> None:
    above, below = figure.subplots(2, 1, sharex=True)
    fold: dict[str, Any] = {"marker": "s", "color": style.BLACK, "ms": 4.5, "mfc": "none"}
    marks: list[tuple[Any, str, dict[str, Any]]] = [
        (points["index"] == 1, "index +1", {"marker": "o", "color": style.BLUE, "ms": 3.0}),
        (points["index"] == -1, "index -1", {"marker": "o", "color": style.VERMILION, "ms": 3.0}),
        (points["fold"].astype(bool), "fold", fold),
    ]
    for axes, (name, label) in zip((above, below), _ROWS, strict=True):
        axes.plot(points["share"], points[name], color=style.GREY, lw=1.0)
        for own, words, look in marks:
            axes.plot(points["share"][own], points[name][own], label=words, ls="", **look)
        axes.set_ylabel(label)
    below.set_xlabel(over, loc="left")
    above.legend(loc="best")


def fit_chart(fit: Mapping[str, Any]) -> Chart:
    """Data, the model at the numbers that were found, and residuals, for curves of fit.json."""
    curves = fit["curves"][:_MOST_CURVES]
    names = ", ".join(dict.fromkeys(curve["column"] for curve in curves))
    return chart(
        "fit",
        f"Measured {names}, the model at the fitted numbers, and the residuals",
        0.5 + 2.9 * len(curves),
        partial(_fit, curves=curves),
    )


def _fit(figure: Figure, curves: Sequence[Mapping[str, Any]]) -> None:
    axes = figure.subplots(2 * len(curves), 1, height_ratios=[1.0, 0.35] * len(curves))
    several = len({curve["file"] for curve in curves}) > 1
    for number, curve in enumerate(curves):
        title = curve["file"] if several else ""
        _curve(axes[2 * number], axes[2 * number + 1], curve, title)
    axes[0].legend(loc="best")


def _curve(above: Axes, below: Axes, curve: Mapping[str, Any], title: str) -> None:
    data, model = np.array(curve["data"]), np.array(curve["model"])
    over = np.array(curve["over"] or np.arange(len(data)))
    order = np.argsort(over, kind="stable")
    sigma = curve["sigma"]
    above.errorbar(over, data, sigma, fmt="o", color=style.BLACK, ms=3.0, lw=0.8, label="data")
    above.plot(over[order], model[order], color=style.BLUE, lw=1.8, label="model", zorder=3)
    above.set_ylabel(curve["column"])
    above.set_title(title, loc="left")
    style.power_beside(above)
    above.tick_params(labelbottom=False)
    below.axhline(0.0, color=style.BLUE, lw=1.2)
    below.vlines(over, 0.0, data - model, color=style.GREY, lw=0.8)
    below.plot(over, data - model, "o", color=style.VERMILION, ms=2.5)
    below.set_ylabel("residual")
    below.set_xlabel(curve["along"] or "row", loc="left")
    below.sharex(above)
