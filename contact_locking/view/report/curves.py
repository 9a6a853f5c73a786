"""Curves of a chart, one for each value of what varies, and how they are told apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from contact_locking.arrays import FloatArray
from contact_locking.view.pictures import style

_COLOURS = (style.BLUE, style.VERMILION, "#009E73", "#CC79A7", style.ORANGE, style.SKY)
_MARKS = "osD^vP"
_MOST_NAMED = len(_COLOURS)
# The largest number of values at a bar of colours.
_MOST_AT_BAR = 12


@dataclass(frozen=True)
class Curve:
    """Values y over finite x, ascending in trends; ``limit`` is the value at x = inf.

    ``label`` names the other keys with their values, ``values`` are these values alone.
    """

    label: str
    x: FloatArray
    y: FloatArray
    limit: float | None = None
    values: str = ""


def has_bar(curves: Sequence[Curve]) -> bool:
    """Whether a bar of colours names the curves, which are too many for a legend."""
    return len(curves) > _MOST_NAMED


def drawing(curves: Sequence[Curve], label: str) -> dict[str, Any]:
    """The colour and the mark of a curve, the same in all charts of these curves."""
    labels = [curve.label for curve in curves]
    number, count = labels.index(label), len(labels)
    colour: Any = _scale(count)(number) if has_bar(curves) else _COLOURS[number]
    mark = _MARKS[number % len(_MARKS)]
    return {"color": colour, "lw": 1.4, "marker": mark, "ms": 4.0}


def _scale(count: int) -> ListedColormap:
    return ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0.0, 0.93, count)))


def name_curves(figure: Figure, curves: Sequence[Curve], varied: str) -> None:
    """Name every curve in a legend, or many curves by their values at a bar of colours.

    ``varied`` names what has these values.
    """
    axes = figure.axes[0]
    if not has_bar(curves):
        handles, labels = axes.get_legend_handles_labels()
        named = [(handle, label) for handle, label in zip(handles, labels, strict=True) if label]
        if named:
            figure.legend(*zip(*named, strict=True), loc="outside upper left")
        return
    count = len(curves)
    norm = BoundaryNorm(np.arange(count + 1) - 0.5, count)
    bar = figure.colorbar(ScalarMappable(norm, _scale(count)), ax=axes, pad=0.02)
    marked = range(0, count, -(-count // _MOST_AT_BAR))
    bar.set_ticks(list(marked), labels=[plain(curves[number].values) for number in marked])
    bar.minorticks_off()
    bar.set_label(plain(varied))


def plain(text: str) -> str:
    """A text without formulas for Matplotlib, short enough for a narrow chart."""
    short = text if len(text) <= 60 else f"{text[:59]}…"
    return short.replace("$", r"\$")
