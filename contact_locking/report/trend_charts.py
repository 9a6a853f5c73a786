"""The charts of a study: quantities over the keys that vary, and rates of convergence."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from contact_locking.plotting import style

from .charts import Chart, chart
from .trends import Curve, Differences, Trend

_COLOURS = (style.BLUE, style.VERMILION, "#009E73", "#CC79A7", style.ORANGE, style.SKY)
_MARKS = "osD^vP"
_MOST_NAMED = len(_COLOURS)
_MOST_TICKS = 6
_PLOT, _ROW = 2.5, 0.19


def trend_charts(trend: Trend) -> list[Chart]:
    """The chart of the values, and if there are differences, a chart of their rates."""
    key, name = trend.axis.key, trend.quantity.key
    stem = _file_name(f"{name}-over-{key}")
    rows = _legend_rows([curve.label for curve in trend.curves])
    if trend.differences and trend.compared == "zero":
        return [_rate_chart(trend, stem)]
    found = [
        chart(
            stem, f"{name} over {key}", _PLOT + rows * _ROW, lambda figure: _values(figure, trend)
        )
    ]
    if trend.differences:
        found.append(_rate_chart(trend, stem))
    return found


def _rate_chart(trend: Trend, stem: str) -> Chart:
    description = f"{_name(trend)} over {trend.axis.key}: distance from {trend.compared}"
    height = _PLOT + _ROW * _legend_rows([each.label for each in trend.differences])
    return chart(f"{stem}-rate", description, height, lambda figure: _rates(figure, trend))


def _values(figure: Figure, trend: Trend) -> None:
    axes = _axes(figure, trend, _name(trend))
    positive = all((curve.y > 0.0).all() for curve in trend.curves)
    values = np.concatenate([curve.y for curve in trend.curves])
    if positive and values.max() > 30.0 * values.min():
        axes.set_yscale("log")
    for number, curve in enumerate(trend.curves):
        drawing = _drawing(number, len(trend.curves))
        axes.plot(curve.x, curve.y, label=_plain(curve.label), **drawing)
        if curve.limit is not None:
            axes.axhline(curve.limit, color=drawing["color"], lw=1.0, ls=(0, (5, 3)), zorder=0.5)
    if any(curve.limit is not None for curve in trend.curves):
        axes.plot(
            [], [], color=style.GREY, lw=1.0, ls=(0, (5, 3)), label=f"at {trend.axis.key} = ∞"
        )
    _legend(figure, trend.curves)


def _rates(figure: Figure, trend: Trend) -> None:
    of = f"distance from {trend.compared.removeprefix('the ')}"
    axes = _axes(figure, trend, _name(trend) if trend.compared == "zero" else of)
    axes.set_yscale("log")
    rates = []
    for number, differences in enumerate(trend.differences):
        drawing = _drawing(number, len(trend.differences))
        law = differences.power_law()
        label = _plain(differences.label) or _name(trend)
        if law is None:
            axes.plot(differences.x, differences.y, label=label, **drawing)
            continue
        rate, factor = law
        rates.append(rate)
        label = f"{label}: rate {_signed(rate)}"
        reliable = differences.reliable
        axes.plot(
            differences.x[reliable], differences.y[reliable], label=label, **drawing | {"ls": ""}
        )
        axes.plot(
            differences.x[~reliable],
            differences.y[~reliable],
            **drawing | {"ls": "", "markerfacecolor": "none"},
        )
        ends = differences.x[reliable][[0, -1]]
        axes.plot(ends, factor * ends**rate, color=drawing["color"], lw=1.2)
    spread = f", rates {_signed(min(rates))} to {_signed(max(rates))}" if rates else ""
    _legend(figure, trend.differences, spread)


def _axes(figure: Figure, trend: Trend, label: str) -> Axes:
    axes = figure.add_subplot()
    x = np.unique(np.concatenate([curve.x for curve in trend.curves]))
    if trend.axis.geometric:
        axes.set_xscale("log")
    elif len(x) <= _MOST_TICKS:
        axes.set_xticks(x)
    axes.set_xlabel(_plain(trend.axis.key))
    axes.set_ylabel(label)
    axes.grid(color=style.PALE, lw=0.6)
    axes.set_axisbelow(True)
    return axes


def _name(trend: Trend) -> str:
    return trend.quantity.key.removeprefix("certificate.")


def _drawing(number: int, count: int) -> dict[str, Any]:
    """A colour and mark for each of a few curves; a scale of colours for many."""
    if count <= _MOST_NAMED:
        colour: Any = _COLOURS[number]
        mark = _MARKS[number]
    else:
        colour = matplotlib.colormaps["viridis"](0.9 * number / (count - 1))
        mark = "o"
    return {"color": colour, "lw": 1.4, "marker": mark, "ms": 4.0}


def _legend(figure: Figure, curves: Sequence[Curve | Differences], of_many: str = "") -> None:
    """Name every curve; of many curves the first and the last, with ``of_many`` about all."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if len(curves) > _MOST_NAMED:
        first, last = _plain(curves[0].label), _plain(curves[-1].label)
        figure.legend(
            [handles[0], handles[len(curves) - 1]],
            [first, f"{last} ({len(curves)} curves{of_many})"],
            loc="outside upper left",
        )
    elif any(labels):
        figure.legend(
            *zip(*((h, t) for h, t in zip(handles, labels, strict=True) if t), strict=True),
            loc="outside upper left",
        )


def _legend_rows(labels: Sequence[str]) -> int:
    return 2 if len(labels) > _MOST_NAMED else len([label for label in labels if label]) + 1


def _plain(text: str) -> str:
    """A text without formulas for Matplotlib, short enough for a narrow chart."""
    short = text if len(text) <= 60 else f"{text[:59]}…"
    return short.replace("$", r"\$")


def _signed(rate: float) -> str:
    return f"{rate:.2f}".replace("-", "\N{MINUS SIGN}")


def _file_name(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9._-]", "_", text)
