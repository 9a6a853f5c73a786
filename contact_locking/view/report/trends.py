"""The results of a study over each key that varies, with their rates of convergence and charts."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.results.in_words import number
from contact_locking.results.quantities import Quantity
from contact_locking.study_file.parameters.study import StudyParameters
from contact_locking.study_file.parameters.wording import texts_of
from contact_locking.view.pictures import style

from .folders import Row
from .page import Chart, Curve, drawing, drawn, gridded, legend_height, name_curves, plain, shown

_MOST_TEXTS = 12


class VariedTexts:
    """The texts of all values of keys in the rows of a study; ``titles`` names these keys."""

    def __init__(self, rows: Sequence[Row], titles: Mapping[str, str]) -> None:
        self.titles = titles
        self._texts: dict[str, dict[str, str]] = {}
        for key in titles:
            values = [row.get(key) for row in rows]
            self._texts[key] = dict(zip(map(repr, values), texts_of(values, shown), strict=True))

    def of(self, row: Row, keys: Iterable[str]) -> list[str]:
        """The texts of the values that a row has for keys that vary."""
        return [self._texts[key][repr(row.get(key))] for key in keys]

    def label(self, row: Row, keys: Sequence[str]) -> str:
        """The keys of a row with the texts of their values."""
        pairs = zip(keys, self.of(row, keys), strict=True)
        return ", ".join(f"{self.titles[key]} = {text}" for key, text in pairs)

    def all_of(self, key: str) -> list[str]:
        """The texts of a key, each once, in the order of the rows; of many the first and last."""
        texts = list(dict.fromkeys(self._texts[key].values()))
        return texts if len(texts) <= _MOST_TEXTS else [*texts[:6], "…", *texts[-2:]]


# Values whose quotient is this large are shown on a logarithmic scale.
_WIDE = 50.0
_SAME_RATIO = 0.05
# Smaller differences, relative to the largest value, may come from the tolerance of the solver.
_TOLERANCE = 1e-8
# Values that differ by less, relative to the largest one, are constant.
_ROUNDING = 1e-7
_FEWEST = 3
_FALLS = 2.0
# The largest standard deviation of the logarithms from a line that still defines a rate: some 35 %.
_SCATTER = 0.3


@dataclass(frozen=True)
class Axis:
    """A key whose values are numbers; the ``others`` vary too, and distinguish the curves.

    ``one_ratio`` says that all neighbouring values have the same quotient.
    """

    key: str
    others: tuple[str, ...]
    geometric: bool
    one_ratio: bool
    title: str


@dataclass(frozen=True)
class Differences:
    """Distances y > 0 to a limit or between neighbours; those below ``floor`` are not reliable."""

    label: str
    x: FloatArray
    y: FloatArray
    floor: float

    @property
    def reliable(self) -> BoolArray:
        """The differences that the tolerance of the solver cannot explain."""
        return self.y > self.floor

    def power_law(self) -> tuple[float, float] | None:
        """Rate and factor of y = factor x^rate.

        None for fewer than three reliable points, and for points that are on no line.
        """
        x, y = self.x[self.reliable], self.y[self.reliable]
        if len(x) < _FEWEST:
            return None
        rate, constant = np.polyfit(np.log(x), np.log(y), 1)
        scatter = np.std(np.log(y) - rate * np.log(x) - constant)
        return (float(rate), float(np.exp(constant))) if scatter < _SCATTER else None


@dataclass(frozen=True)
class Trend:
    """A quantity over an axis; ``differences`` are its distances from ``compared``, in words."""

    quantity: Quantity
    axis: Axis
    curves: list[Curve]
    differences: list[Differences]
    compared: str


def axes(study: StudyParameters, rows: Sequence[Row], titles: Mapping[str, str]) -> list[Axis]:
    """The keys of a study with at least two different numbers, geometric sequences first.

    ``titles`` names the keys.
    """
    varied = []
    for key in (*study.zip, *study.vary):
        values = [number(row.get(key)) for row in rows]
        finite = sorted({value for value in values if value is not None and np.isfinite(value)})
        if None in values or len(set(values)) < 2 or len(finite) < 2:
            continue
        # Lists that are zipped vary as one.
        together = set(study.zip) if key in study.zip else {key}
        others = tuple(other for other in (*study.zip, *study.vary) if other not in together)
        enough = len(finite) >= _FEWEST and finite[0] > 0.0
        one_ratio = enough and _has_one_ratio(finite)
        geometric = enough and (one_ratio or finite[-1] / _WIDE >= finite[0])
        varied.append(Axis(key, others, geometric, one_ratio, titles[key]))
    return sorted(varied, key=lambda axis: not axis.geometric)


def trends(
    axis: Axis, rows: Iterable[Row], texts: VariedTexts, quantities: Mapping[str, Quantity]
) -> list[Trend]:
    """Those of the quantities that change along an axis, from the converged cases."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        if row.get("converged") is True:
            groups.setdefault(texts.label(row, axis.others), []).append(row)
    result = []
    for quantity in (quantity for quantity in quantities.values() if quantity.trend):
        curves = [_curve(axis, quantity, members, texts) for members in groups.values()]
        curves = [curve for curve in curves if len(curve.x)]
        if any(differ(curve.y) for curve in curves):
            result.append(_trend(quantity, axis, curves))
    return result


def differ(values: Sequence[float] | FloatArray) -> bool:
    """Whether numbers differ by more than rounding and the tolerance of the solver explain."""
    numbers = np.asarray(values, dtype=float)
    if not np.isfinite(numbers).all():
        return len(np.unique(numbers)) > 1
    return bool(np.ptp(numbers) > _ROUNDING * np.abs(numbers).max())


def _value(quantity: Quantity, row: Row) -> float | None:
    """A quantity of a row; for a vector, which has a column for each component, its length."""
    if quantity.key in row:
        return number(row[quantity.key])
    parts = [number(row.get(f"{quantity.key}.{index}")) for index in range(3)]
    present = [component for component in parts if component is not None]
    return float(np.linalg.norm(present)) if present else None


def _curve(axis: Axis, quantity: Quantity, rows: Sequence[Row], texts: VariedTexts) -> Curve:
    pairs = {}
    for row in rows:
        x, y = number(row.get(axis.key)), _value(quantity, row)
        if x is not None and y is not None and np.isfinite(y):
            pairs[x] = y
    limit = pairs.pop(np.inf, None)
    array = np.array(sorted(pairs.items())).reshape(-1, 2)
    return Curve(texts.label(rows[0], axis.others), array[:, 0], array[:, 1], limit)


def _trend(quantity: Quantity, axis: Axis, curves: list[Curve]) -> Trend:
    limited = [(curve, curve.limit) for curve in curves if curve.limit is not None]
    compared: str = "the value at infinity" if limited else "the next value"
    differences: list[Differences] = []
    settles = quantity.trend in ("settles", "vanishes")
    # An error that changes enough along a curve has a rate.
    falls = any(np.abs(c.y).max() >= _FALLS * np.abs(c.y).min() for c in curves)
    if axis.geometric and quantity.trend == "vanishes" and falls:
        compared = "zero"
        differences = [_differences(curve, curve.x, np.abs(curve.y)) for curve in curves]
    elif axis.geometric and settles and limited:
        # |q(x) - q(inf)|
        differences = [_differences(c, c.x, np.abs(c.y - limit)) for c, limit in limited]
    elif axis.one_ratio and settles:
        # |q(x) - q(next x)| falls at the rate of the error in a geometric sequence.
        differences = [_differences(c, c.x[:-1], np.abs(np.diff(c.y))) for c in curves]
    shown = [difference for difference in differences if len(difference.x) > 1]
    return Trend(quantity, axis, curves, shown, compared)


def _differences(curve: Curve, x: FloatArray, y: FloatArray) -> Differences:
    floor = _TOLERANCE * float(np.abs(curve.y).max(initial=0.0))
    return Differences(curve.label, x[y > 0.0], y[y > 0.0], floor)


def _has_one_ratio(values: Sequence[float]) -> bool:
    """Whether all quotients of neighbours are equal, for positive ascending numbers."""
    steps = np.diff(np.log(values))
    return bool(np.abs(steps - steps.mean()).max() <= _SAME_RATIO * steps.mean())


_MOST_TICKS = 6
# A shorter range has few powers of ten for marks, and values of equal ratio.
_SHORT = 50.0
_PLOT = 2.7


def trend_charts(trend: Trend) -> list[Chart]:
    """The chart of the values, and if there are differences, a chart of their rates."""
    stem = re.sub(r"[^A-Za-z0-9._-]", "_", f"{trend.quantity.key}-over-{trend.axis.key}")
    about, charts = f"{trend.quantity.name} over the {trend.axis.title}", list[Chart]()
    unit = trend.quantity.unit
    label = trend.quantity.name if unit == "1" else f"{trend.quantity.name} [{unit}]"
    if not trend.differences or trend.compared != "zero":
        height = _PLOT + legend_height(sum(bool(curve.label) for curve in trend.curves))
        with drawn(charts, stem, about, height) as figure:
            axes = _axes(figure, trend, label)
            positive = all((curve.y > 0.0).all() for curve in trend.curves)
            values = np.concatenate([curve.y for curve in trend.curves])
            if positive and values.max() > 30.0 * values.min():
                axes.set_yscale("log")
            dashed: dict[str, Any] = {"lw": 1.0, "ls": (0, (5, 3))}
            for curve in trend.curves:
                look = drawing(trend.curves, curve.label)
                axes.plot(curve.x, curve.y, label=plain(curve.label), **look)
                if curve.limit is not None:
                    axes.axhline(curve.limit, color=look["color"], zorder=0.5, **dashed)
            if any(curve.limit is not None for curve in trend.curves):
                at = plain(f"at {trend.axis.title} = ∞")
                axes.plot([], [], color=style.GREY, label=at, **dashed)
            name_curves(figure)
    if trend.differences:
        height = _PLOT + legend_height(len(trend.differences))
        about = f"{about}: distance from {trend.compared}"
        of = f"distance from {trend.compared.removeprefix('the ')}"
        with drawn(charts, f"{stem}-rate", about, height) as figure:
            axes = _axes(figure, trend, label if trend.compared == "zero" else of)
            axes.set_yscale("log")
            for differences in trend.differences:
                look = drawing(trend.curves, differences.label)
                name, law = plain(differences.label) or trend.quantity.name, differences.power_law()
                x, y, reliable = differences.x, differences.y, differences.reliable
                if law is None:
                    axes.plot(x, y, label=name, **look)
                    continue
                rate, factor = law
                signed = f"{rate:.2f}".replace("-", "\N{MINUS SIGN}")
                look |= {"ls": ""}
                axes.plot(x[reliable], y[reliable], label=f"{name}: rate {signed}", **look)
                axes.plot(x[~reliable], y[~reliable], markerfacecolor="none", **look)
                ends = x[reliable][[0, -1]]
                axes.plot(ends, factor * ends**rate, color=look["color"], lw=1.2)
            name_curves(figure)
    return charts


def _axes(figure: Figure, trend: Trend, label: str) -> Axes:
    axes = gridded(figure, plain(trend.axis.title), label)
    x = np.unique(np.concatenate([curve.x for curve in trend.curves]))
    if trend.axis.geometric:
        axes.set_xscale("log")
        if len(x) <= _MOST_TICKS and x[-1] < _SHORT * x[0]:
            axes.set_xticks(x, labels=[shown(float(value)) for value in x])
            axes.minorticks_off()
    elif len(x) <= _MOST_TICKS:
        axes.set_xticks(x)
    return axes
