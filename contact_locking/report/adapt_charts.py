"""The charts of adapted meshes: the error over the unknowns, and the meshes side by side."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from contact_locking.errors import InputError
from contact_locking.plotting import style
from contact_locking.plotting.mesh_lines import draw_mesh
from contact_locking.results.adapted_meshes import AdaptedMesh, load
from contact_locking.results.read import RunResults, number

from .charts import WIDTH, Chart, chart

_COLUMNS, _MOST = 3, 12
_LABELS = {"estimate": "estimate, by recovery", "bound": "guaranteed bound"}
_LOOKS = {"estimate": (style.BLUE, "o"), "bound": (style.VERMILION, "s")}


def adapt_charts(run: RunResults) -> list[Chart]:
    """The charts of a run with adapted meshes; none for other runs."""
    rows = adapted(run.summary)
    if not rows:
        return []
    found = []
    if any(_values(rows, name) for name in _LABELS):
        found.append(
            chart(
                "adapt-error",
                "Relative error over the number of unknowns, for each of the adapted meshes",
                3.0,
                lambda figure: _errors(figure, rows, run.summary["adapt"].get("tolerance")),
            )
        )
    meshes = _meshes(run, len(rows))
    if meshes:
        found.append(_multiples(meshes, rows))
    return found


def adapted(summary: dict[str, Any]) -> list[dict[str, Any]]:
    """The entries ``adapt.meshes`` of a summary; empty without."""
    entry = summary.get("adapt")
    meshes = entry.get("meshes") if isinstance(entry, dict) else None
    return [row for row in meshes if isinstance(row, dict)] if isinstance(meshes, list) else []


def _values(rows: list[dict[str, Any]], name: str) -> list[tuple[float, float]]:
    """Unknowns and errors of the meshes that have both."""
    pairs = [(number(row.get("dofs")), number(row.get(name))) for row in rows]
    return [(x, y) for x, y in pairs if x is not None and y is not None and x > 0.0 and y > 0.0]


def _errors(figure: Figure, rows: list[dict[str, Any]], tolerance: Any) -> None:
    axes = figure.add_subplot()
    for name, label in _LABELS.items():
        if found := _values(rows, name):
            colour, marker = _LOOKS[name]
            axes.loglog(*zip(*found, strict=True), color=colour, marker=marker, ms=4, label=label)
    limit = number(tolerance)
    if limit is not None and limit > 0.0:
        axes.axhline(limit, color=style.GREY, lw=1.0, ls=(0, (5, 3)), label="tolerance", zorder=0.5)
    axes.grid(visible=True, which="major", color=style.PALE, lw=0.6)
    axes.set_axisbelow(True)
    axes.set_xlabel("unknowns")
    axes.set_ylabel("relative error")
    axes.legend()


def _meshes(run: RunResults, count: int) -> list[tuple[int, AdaptedMesh]]:
    """At most so many meshes as fit, with their places in the sequence."""
    if run.meshes is None:
        return []
    try:
        meshes = load(run.meshes)
    except InputError:
        return []
    last = min(len(meshes), count) - 1
    shown = np.unique(np.linspace(0, last, _MOST).round().astype(int)) if last >= 0 else []
    return [(int(place), meshes[place]) for place in shown]


def _multiples(meshes: list[tuple[int, AdaptedMesh]], rows: list[dict[str, Any]]) -> Chart:
    lines = -(-len(meshes) // _COLUMNS)
    low, high = (f(meshes[0][1].x, axis=0) for f in (np.min, np.max))
    extent = np.maximum(high - low, 1e-300)
    shape = float(extent[1] / extent[0]) if len(extent) == 2 else 1.0
    height = lines * (WIDTH / _COLUMNS * min(max(shape, 0.2), 2.0) + 0.25)

    def draw(figure: Figure) -> None:
        places = figure.subplots(lines, _COLUMNS, squeeze=False).ravel()
        for axes in places[len(meshes) :]:
            axes.set_axis_off()
        for axes, (place, mesh) in zip(places, meshes, strict=False):
            draw_mesh(axes, mesh)
            axes.set_title(f"{rows[place].get('dofs')} unknowns", fontsize=8)

    return chart("adapt-meshes", "The adapted meshes; coloured cells were marked", height, draw)
