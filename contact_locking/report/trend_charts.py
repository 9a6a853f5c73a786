"""The charts of a study: quantities over the keys that vary, and rates of convergence."""

from __future__ import annotations

import re
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from contact_locking.plotting import style

from .charts import Chart, chart
from .shown import shown
from .trends import Trend

_COLOURS = (style.BLUE, style.VERMILION, "#009E73", "#CC79A7", style.ORANGE, style.SKY)
_MARKS = "osD^vP"
_MOST_NAMED = len(_COLOURS)
_MOST_TICKS = 6
# The largest number of values at a bar of colours.
_MOST_AT_BAR = 12
# A shorter range has few powers of ten for marks, and values of equal ratio.
_SHORT = 50.0
_PLOT, _ROW = 2.5, 0.19


def trend_charts(trend: Trend) -> list[Chart]:
    """The chart of the values, and if there are differences, a chart of their rates."""
    stem = _file_name(f"{trend.quantity.key}-over-{trend.axis.key}")
    if trend.differences and trend.compared == "zero":
        return [_rate_chart(trend, stem)]
    rows = 0 if _has_bar(trend) else 1 + sum(bool(curve.label) for curve in trend.curves)
    description = f"{trend.quantity.name} over the {trend.axis.title}"
    found = [chart(stem, description, _PLOT + rows * _ROW, lambda figure: _values(figure, trend))]
    if trend.differences:
        found.append(_rate_chart(trend, stem))
    return found


def _rate_chart(trend: Trend, stem: str) -> Chart:
    over = trend.axis.title
    description = f"{trend.quantity.name} over the {over}: distance from {trend.compared}"
    rows = 1 if _has_bar(trend) else 1 + len(trend.differences)
    height = _PLOT + _ROW * rows
    return chart(f"{stem}-rate", description, height, lambda figure: _rates(figure, trend))


def _values(figure: Figure, trend: Trend) -> None:
    axes = _axes(figure, trend, _label(trend))
    positive = all((curve.y > 0.0).all() for curve in trend.curves)
    values = np.concatenate([curve.y for curve in trend.curves])
    if positive and values.max() > 30.0 * values.min():
        axes.set_yscale("log")
    for curve in trend.curves:
        drawing = _drawing(trend, curve.label)
        axes.plot(curve.x, curve.y, label=_plain(curve.label), **drawing)
        if curve.limit is not None:
            axes.axhline(curve.limit, color=drawing["color"], lw=1.0, ls=(0, (5, 3)), zorder=0.5)
    if any(curve.limit is not None for curve in trend.curves):
        at = f"at {trend.axis.title} = ∞"
        axes.plot([], [], color=style.GREY, lw=1.0, ls=(0, (5, 3)), label=_plain(at))
    _name_curves(figure, trend)


def _rates(figure: Figure, trend: Trend) -> None:
    of = f"distance from {trend.compared.removeprefix('the ')}"
    axes = _axes(figure, trend, _label(trend) if trend.compared == "zero" else of)
    axes.set_yscale("log")
    rates = []
    for differences in trend.differences:
        drawing = _drawing(trend, differences.label)
        law = differences.power_law()
        label = _plain(differences.label) or trend.quantity.name
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
    if rates and _has_bar(trend):
        spread = f"rates {_signed(min(rates))} to {_signed(max(rates))}"
        axes.set_title(f"{len(trend.differences)} curves, {spread}", loc="left", fontsize=8.5)
    _name_curves(figure, trend)


def _axes(figure: Figure, trend: Trend, label: str) -> Axes:
    axes = figure.add_subplot()
    x = np.unique(np.concatenate([curve.x for curve in trend.curves]))
    if trend.axis.geometric:
        axes.set_xscale("log")
        if len(x) <= _MOST_TICKS and x[-1] < _SHORT * x[0]:
            axes.set_xticks(x, labels=[shown(float(value)) for value in x])
            axes.minorticks_off()
    elif len(x) <= _MOST_TICKS:
        axes.set_xticks(x)
    axes.set_xlabel(_plain(trend.axis.title))
    axes.set_ylabel(label)
    axes.grid(color=style.PALE, lw=0.6)
    axes.set_axisbelow(True)
    return axes


def _label(trend: Trend) -> str:
    unit = trend.quantity.unit
    return trend.quantity.name if unit == "1" else f"{trend.quantity.name} [{unit}]"


def _has_bar(trend: Trend) -> bool:
    """Whether a bar of colours names the curves, which are too many for a legend."""
    return len(trend.curves) > _MOST_NAMED


def _drawing(trend: Trend, label: str) -> dict[str, Any]:
    """The colour and the mark of a curve, the same in all charts of a trend."""
    labels = [curve.label for curve in trend.curves]
    number, count = labels.index(label), len(labels)
    colour: Any = _scale(count)(number) if _has_bar(trend) else _COLOURS[number]
    mark = _MARKS[number % len(_MARKS)]
    return {"color": colour, "lw": 1.4, "marker": mark, "ms": 4.0}


def _scale(count: int) -> ListedColormap:
    """As many colours as there are curves."""
    return ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0.0, 0.93, count)))


def _name_curves(figure: Figure, trend: Trend) -> None:
    """Name every curve in a legend, or many curves by their values at a bar of colours."""
    axes = figure.axes[0]
    if not _has_bar(trend):
        handles, labels = axes.get_legend_handles_labels()
        named = [(handle, label) for handle, label in zip(handles, labels, strict=True) if label]
        if named:
            figure.legend(*zip(*named, strict=True), loc="outside upper left")
        return
    count = len(trend.curves)
    norm = BoundaryNorm(np.arange(count + 1) - 0.5, count)
    bar = figure.colorbar(ScalarMappable(norm, _scale(count)), ax=axes, pad=0.02)
    marked = range(0, count, -(-count // _MOST_AT_BAR))
    values = [_plain(trend.curves[number].values) for number in marked]
    bar.set_ticks(list(marked), labels=values)
    bar.minorticks_off()
    bar.set_label(_plain(", ".join(trend.axis.other_titles)))


def _plain(text: str) -> str:
    """A text without formulas for Matplotlib, short enough for a narrow chart."""
    short = text if len(text) <= 60 else f"{text[:59]}…"
    return short.replace("$", r"\$")


def _signed(rate: float) -> str:
    return f"{rate:.2f}".replace("-", "\N{MINUS SIGN}")


def _file_name(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9._-]", "_", text)
