"""Bars of elasticities: the change of a result by 1 % more of each number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from matplotlib.figure import Figure

from contact_locking.extras.pictures import style
from contact_locking.results.read import number

from .charts import Chart, chart

# More bars would be no chart.
_MOST_BARS, _MOST_CHARTS = 20, 8
_LONGEST = 34


def rows_of_derivatives(summary: Mapping[str, Any]) -> list[tuple[str, str, Any, Any]]:
    """Each result with the number, the derivative and the elasticity, large ones first."""
    found = summary.get("sensitivities")
    rows: list[tuple[str, str, Any, Any]] = []
    for result, entries in found.items() if isinstance(found, dict) else ():
        own = [
            (result, key, number(entry.get("derivative")), number(entry.get("elasticity")))
            for key, entry in (entries.items() if isinstance(entries, dict) else ())
            if isinstance(entry, dict)
        ]
        rows += sorted(own, key=lambda row: -abs(row[3] or 0.0))
    return rows


def derivative_charts(summary: Mapping[str, Any]) -> list[Chart]:
    """A chart for each result that has elasticities."""
    bars: dict[str, list[tuple[str, float]]] = {}
    for result, key, _, elasticity in rows_of_derivatives(summary):
        if elasticity is not None:
            bars.setdefault(result, []).append((key, elasticity))
    return [
        chart(
            f"elasticities-{position}",
            f"What 1 % more of each number does to {result}, in per cent",
            1.0 + 0.3 * min(len(own), _MOST_BARS),
            partial(_draw, bars=own[:_MOST_BARS]),
        )
        for position, (result, own) in enumerate(list(bars.items())[:_MOST_CHARTS], start=1)
    ]


def _draw(figure: Figure, bars: Sequence[tuple[str, float]]) -> None:
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
