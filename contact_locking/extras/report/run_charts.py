"""Charts of a run: of each contact, of the history of a process, and of adapted meshes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.extras.pictures import contact_map, plane, style
from contact_locking.results.adapted_meshes import AdaptedMesh, load
from contact_locking.results.contact_points import ContactPoints, contact_name, facets_within
from contact_locking.results.history import History
from contact_locking.results.ordering import curves
from contact_locking.results.quantities import QUANTITIES
from contact_locking.results.read import RunResults
from contact_locking.results.read import number as finite

from .charts import WIDTH, Chart, chart

# The stem of a name, a description, the height, and the function that draws the chart.
_Drawing = tuple[str, str, float, Callable[[Figure], None]]


def contact_charts(run: RunResults) -> list[tuple[str, list[Chart]]]:
    """The charts of each contact, with the name of the contact if there are several."""
    found = []
    rows = run.contact.rows()
    largest = float(run.contact.pressure.max(initial=0.0))
    for number, own in enumerate(rows, start=1):
        points, facets = run.contact[own], facets_within(run.facets, own)
        drawings = _profiles(points, facets, largest) if points.dim == 2 else _maps(points, facets)
        name = contact_name(run.summary, int(points.contact[0])) if len(rows) > 1 else ""
        ending, told = (f"-{number}", f": {name}") if len(rows) > 1 else ("", "")
        charts = [
            chart(f"{stem}{ending}", f"{about}{told}", height, draw)
            for stem, about, height, draw in drawings
        ]
        found.append((name, charts))
    return found


def _profiles(contact: ContactPoints, facets: IntArray, largest: float) -> list[_Drawing]:
    """In two dimensions; ``largest`` is the largest pressure of all contacts."""
    along = "along the contact boundary"
    tractions = f"Contact pressure, friction traction and its bound {along}"
    slip = f"Tangential displacement and distance to the foundation {along}"
    return [
        ("tractions", tractions, 3.6, lambda figure: _profile(figure, contact, facets, largest)),
        ("slip", slip, 2.6, lambda figure: _opening(figure, contact, facets)),
    ]


def _maps(contact: ContactPoints, facets: IntArray) -> list[_Drawing]:
    height, seen = _map_height(contact), "seen from the foundation"
    pressure = (contact.pressure, r"contact pressure $-\sigma_\nu$")
    friction = (np.linalg.norm(contact.traction, axis=1), r"friction traction $|\sigma_\tau|$")
    states = f"Map of open, sticking and slipping points, {seen}"
    return [
        (stem, f"Map of the {about}, {seen}", height, partial(_map, contact, facets, *values))
        for stem, about, values in (
            ("pressure", "contact pressure", pressure),
            ("friction", "friction traction", friction),
        )
    ] + [("states", states, height, lambda figure: _state_map(figure, contact, facets))]


def _profile(figure: Figure, contact: ContactPoints, facets: IntArray, largest: float) -> None:
    axes, strip = figure.subplots(2, 1, height_ratios=(1.0, 0.07))
    plane.draw_tractions(axes, strip, contact, facets, largest)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)


def _opening(figure: Figure, contact: ContactPoints, facets: IntArray) -> None:
    axes = figure.add_subplot()
    parts = curves(facets)
    positions, label = plane.abscissa([contact.x[part] for part in parts])
    for number, (s, part) in enumerate(zip(positions, parts, strict=True)):
        slip = plane.along(contact.u_tangent[part], contact.x[part], s)
        distance = contact.gap[part] - contact.u_normal[part]
        name = (lambda text: text) if number == 0 else (lambda text: "_" + text)
        axes.plot(s, slip, color=style.VERMILION, lw=1.6, label=name(r"tangential $u_\tau$"))
        axes.plot(s, distance, color=style.BLUE, lw=1.8, label=name(r"distance $g - u_\nu$"))
    axes.axhline(0.0, color=style.GREY, lw=0.7, zorder=0.5)
    axes.margins(x=0.0)
    axes.set_xlabel(label, loc="left")
    axes.set_ylabel("length")
    figure.legend(loc="outside upper left", ncols=2)


def _map_height(contact: ContactPoints) -> float:
    i, j, _ = contact_map.frame(contact)
    width, height = np.ptp(contact.x[:, [i, j]], axis=0)
    return float(np.clip(0.85 * WIDTH * height / (width or 1.0), 2.0, 6.0)) + 0.9


def _map(
    contact: ContactPoints, facets: IntArray, values: FloatArray, label: str, figure: Figure
) -> None:
    axes = figure.add_subplot(aspect="equal")
    colours = contact_map.colour_values(
        axes, contact, facets, values, cmap="cividis", vmin=0.0, rasterized=True
    )
    figure.colorbar(colours, ax=axes, orientation="horizontal", label=label, aspect=40, pad=0.02)


def _state_map(figure: Figure, contact: ContactPoints, facets: IntArray) -> None:
    axes = figure.add_subplot(aspect="equal")
    contact_map.colour_states(axes, contact, facets, rasterized=True)
    figure.legend(handles=style.state_patches(), loc="outside lower center", ncols=3)


_WORK = {
    "work_total": "work of the loads",
    "stored": "stored",
    "dissipated_total": "dissipated by friction",
    "numerical_total": "lost by the method",
}
# The names of files for units that are no words.
_FILES = {"1": "strain", "force · length": "moment"}
_COLOURS = (style.BLUE, style.VERMILION, style.BLACK, style.ORANGE)


def history_charts(history: History) -> list[Chart]:
    """The charts of a process, without a step that did not converge; none without two steps."""
    history = History([row for row in history if row.get("converged", 1)])
    if len(history) < 2:
        return []
    drawn: dict[str, dict[str, str]] = {}
    for column in history.columns:
        is_scalar = column in QUANTITIES
        quantity = QUANTITIES.get(column if is_scalar else column[:-2])
        if quantity and not quantity.detail and np.isfinite(history.column(column)).any():
            label = "place" if quantity.is_place else quantity.unit
            label = "share" if quantity.share_of else label
            name = quantity.name if is_scalar else f"{quantity.name}, {column[-1]}"
            drawn.setdefault(label, {})[column] = name
    drawn["energy"] = _WORK
    return [
        chart(
            f"history-{_FILES.get(label, label)}",
            f"{', '.join(lines.values())} over the time",
            2.4 + 0.1 * len(lines),
            partial(_curves, history=history, label="" if label == "1" else label, lines=lines),
        )
        for label, lines in drawn.items()
    ]


def _curves(figure: Figure, history: History, label: str, lines: Mapping[str, str]) -> None:
    axes = figure.add_subplot()
    time = history.column("t")
    for number, (column, name) in enumerate(lines.items()):
        dashes = "-" if number < len(_COLOURS) else "--"
        colour = _COLOURS[number % len(_COLOURS)]
        axes.plot(time, history.column(column), dashes, color=colour, label=name)
    # From zero on, so that rounding in a constant is not seen.
    axes.axhline(0.0, color=style.GREY, lw=0.7, zorder=0.5)
    axes.set(xlabel="t", ylabel=label)
    figure.legend(loc="outside upper center", ncols=2, fontsize="small")


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
    meshes: list[dict[str, Any]] = summary.get("adapt", {}).get("meshes", [])
    return meshes


def _values(rows: list[dict[str, Any]], name: str) -> list[tuple[float, float]]:
    """Unknowns and errors of the meshes that have both."""
    pairs = [(finite(row.get("dofs")), finite(row.get(name))) for row in rows]
    return [(x, y) for x, y in pairs if x is not None and y is not None and x > 0.0 and y > 0.0]


def _errors(figure: Figure, rows: list[dict[str, Any]], tolerance: Any) -> None:
    axes = figure.add_subplot()
    for name, label in _LABELS.items():
        if found := _values(rows, name):
            colour, marker = _LOOKS[name]
            axes.loglog(*zip(*found, strict=True), color=colour, marker=marker, ms=4, label=label)
    limit = finite(tolerance)
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


# Towards the eye, for the surface of a body in 3D: from the front and from below, where contact is.
_TO_EYE = np.array([0.45, -0.8, -0.4])
_UP = np.array([0.0, 0.0, 1.0])
# Edges of the finest meshes would cover their cells.
_WIDEST, _CELLS = 0.5, 600.0


def draw_mesh(axes: Axes, mesh: AdaptedMesh) -> None:
    """Draw the edges of a mesh; marked cells are coloured.

    The lines become an image, because a picture of all lines would be as large as the mesh.
    """
    x, triangles, marked = mesh.x, mesh.triangles, mesh.marked
    if mesh.dim == 3:
        x, order = _seen(x, triangles)
        triangles, marked = triangles[order], marked[order]
    width = min(_WIDEST, _WIDEST * (_CELLS / max(len(triangles), 1)) ** 0.5)
    axes.add_collection(
        PolyCollection(
            list(x[triangles]),
            facecolors=np.where(marked, style.ORANGE, "white").tolist(),
            edgecolors=style.BLACK,
            linewidths=width,
            rasterized=True,
        )
    )
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()


def _seen(x: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray]:
    """The points (v, 2) in the plane of the picture, and the triangles from back to front."""
    eye = _TO_EYE / np.linalg.norm(_TO_EYE)
    right = np.cross(_UP, eye)
    right /= np.linalg.norm(right)
    plane: FloatArray = np.column_stack([x @ right, x @ np.cross(eye, right)])
    depth = (x @ eye)[triangles].mean(axis=1)
    return plane, np.asarray(np.argsort(depth), dtype=np.int64)


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
