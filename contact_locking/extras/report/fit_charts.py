"""The picture of a fit: measured data, the model at the numbers that were found, and residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from contact_locking.extras.pictures import style

from .charts import Chart, chart

# The entries of fit.json that the page and its chart take.
_LISTS, _OF_NUMBERS = ("over", "data", "model"), ("value", "standard_error", "start")
# More curves would be no picture.
_MOST = 6


def readable_fit(content: Mapping[str, Any] | None) -> Mapping[str, Any] | None:
    """The content of fit.json; None without one, and for one that is damaged."""
    if content is None:
        return None
    try:
        for curve in content["curves"]:
            sizes = {len(np.array(curve[name], dtype=float)) for name in _LISTS if curve[name]}
            texts = [curve[name] for name in ("column", "file", "along")]
            if len(sizes) != 1 or not all(isinstance(text, str) for text in texts):
                return None
            if curve["sigma"] is not None and {len(curve["sigma"])} != sizes:
                return None
        for entry in content["parameters"].values():
            if len(entry["interval"]) != 2 or not {"value", "standard_error", "start"} <= set(
                entry
            ):
                return None
        told = [*content["words"], *content["undetermined"]]
        is_whole = content["curves"] and all(isinstance(text, str) for text in told)
        return content if is_whole and {"evaluations", "misfit"} <= set(content) else None
    except (KeyError, TypeError, ValueError, AttributeError):
        return None


def fit_chart(fit: Mapping[str, Any]) -> Chart:
    """Data, model and residuals of each curve of fit.json."""
    curves = fit["curves"][:_MOST]
    names = ", ".join(dict.fromkeys(curve["column"] for curve in curves))
    return chart(
        "fit",
        f"Measured {names}, the model at the fitted numbers, and the residuals",
        0.5 + 2.9 * len(curves),
        partial(_draw, curves=curves),
    )


def _draw(figure: Figure, curves: Sequence[Mapping[str, Any]]) -> None:
    axes = figure.subplots(2 * len(curves), 1, height_ratios=[1.0, 0.35] * len(curves))
    several = len({curve["file"] for curve in curves}) > 1
    for number, curve in enumerate(curves):
        title = curve["file"] if several else ""
        _curve(axes[2 * number], axes[2 * number + 1], curve, title, number == 0)


def _curve(above: Axes, below: Axes, curve: Mapping[str, Any], title: str, labels: bool) -> None:
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
    if labels:
        above.legend(loc="best")
