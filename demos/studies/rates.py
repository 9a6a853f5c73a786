"""Log-log plots of studies in which each curve has its fitted rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from convergence import fitted_rate
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from contact_locking.view.pictures import style

_COLOURS = (style.BLUE, style.VERMILION, style.ORANGE, style.SKY, style.BLACK, style.GREY)
_MARKERS = "osD^vP"
_PANEL = (4.3, 3.7)


@dataclass(frozen=True)
class Curve:
    """Values over a parameter, with a rate fitted to the last ``fitted`` points unless that is 0.

    ``plain`` curves, such as bounds, are dashed and grey, without markers.
    """

    label: str
    x: Sequence[float]
    y: Sequence[float]
    fitted: int = 0
    plain: bool = False

    @property
    def rate(self) -> float | None:
        """The fitted exponent of ``y = C x^rate``."""
        if not self.fitted:
            return None
        return fitted_rate(self.x[-self.fitted :], self.y[-self.fitted :])

    @property
    def text(self) -> str:
        """The label with the rate."""
        return self.label if self.rate is None else f"{self.label}:  {self.rate:.2f}"


@dataclass(frozen=True)
class Panel:
    """One set of axes, which are both ``logarithmic`` or both linear."""

    title: str
    x: str
    y: str
    curves: Sequence[Curve]
    logarithmic: bool = True


def rate_plot(panels: Sequence[Panel], path: Path) -> None:
    """Draw panels side by side into a file, whose suffix tells the format, such as .svg or .png.

    A thin line through the fitted points shows each rate, and the legend gives its value.
    """
    # With a fixed salt and without a date the same curves give the same file.
    with matplotlib.rc_context({**style.RC, "svg.hashsalt": "contact_locking"}):
        width, height = _PANEL
        figure = Figure(figsize=(width * len(panels), height), layout="constrained")
        FigureCanvasAgg(figure)
        for axes, panel in zip(
            figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True
        ):
            _draw(axes, panel)
        kind = path.suffix.removeprefix(".")
        metadata = {"Date": None} if kind == "svg" else {}
        figure.savefig(path, format=kind, dpi=style.DPI, facecolor="white", metadata=metadata)


def _draw(axes: Any, panel: Panel) -> None:
    looks = iter(zip(_COLOURS, _MARKERS, strict=True))
    for curve in panel.curves:
        if curve.plain:
            axes.plot(curve.x, curve.y, "--", color=style.GREY, lw=1.2, label=curve.text)
            continue
        colour, marker = next(looks)
        line = "none" if curve.fitted else "-"
        # Hollow markers leave both of two equal values visible.
        look = {"color": colour, "mfc": "none", "ms": 6, "lw": 1.0}
        axes.plot(curve.x, curve.y, marker, ls=line, label=curve.text, **look)
        if curve.rate is not None:
            x = np.asarray(curve.x[-curve.fitted :], dtype=float)
            logs = np.log(np.asarray(curve.y[-curve.fitted :], dtype=float))
            middle = np.exp(np.mean(logs) - curve.rate * np.mean(np.log(x)))
            axes.plot(x, middle * x**curve.rate, "-", color=colour, lw=1.0)
    if panel.logarithmic:
        axes.set_xscale("log")
        axes.set_yscale("log")
    axes.grid(visible=True, which="major", color=style.PALE, lw=0.6)
    axes.set_axisbelow(True)
    axes.set_title(panel.title)
    axes.set_xlabel(panel.x)
    axes.set_ylabel(panel.y)
    axes.legend()
