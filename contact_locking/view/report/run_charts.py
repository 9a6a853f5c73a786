"""Charts of a run: of each contact, of adapted meshes, derivatives, branches and fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.results.adapted_meshes import AdaptedMesh, load
from contact_locking.results.contact_points import ContactPoints, contact_name, facets_within
from contact_locking.results.ordering import curves
from contact_locking.results.read import RunResults
from contact_locking.results.read import number as finite
from contact_locking.view.pictures import contact_map, plane, style
from contact_locking.view.pictures.views import camera

from .charts import WIDTH, Chart, chart


def contact_charts(run: RunResults) -> list[tuple[str, list[Chart]]]:
    """The charts of each contact, with the name of the contact if there are several."""
    found = []
    rows = run.contact.rows()
    largest = float(run.contact.pressure.max(initial=0.0))
    for number, own in enumerate(rows, start=1):
        points, facets = run.contact[own], facets_within(run.facets, own)
        name = contact_name(run.summary, int(points.contact[0])) if len(rows) > 1 else ""
        ending, told = (f"-{number}", f": {name}") if len(rows) > 1 else ("", "")
        charts = [
            chart(f"{stem}{ending}", f"{about}{told}", height, draw, points, facets, *more)
            for stem, about, height, draw, *more in _drawings(points, largest)
        ]
        found.append((name, charts))
    return found


def _drawings(contact: ContactPoints, largest: float) -> list[tuple[Any, ...]]:
    """The stems of names, descriptions, heights, functions that draw, and their last arguments.

    ``largest`` is the largest pressure of all contacts.
    """
    along, seen = "along the contact boundary", "seen from the foundation"
    if contact.dim == 2:
        tractions = f"Contact pressure, friction traction and its bound {along}"
        slip = f"Tangential displacement and distance to the foundation {along}"
        return [("tractions", tractions, 3.6, _profile, largest), ("slip", slip, 2.6, _opening)]
    pressure = f"Map of the contact pressure, {seen}", _map_height(contact), _map, contact.pressure
    size = np.linalg.norm(contact.traction, axis=1)
    friction = f"Map of the friction traction, {seen}", _map_height(contact), _map, size
    states = f"Map of open, sticking and slipping points, {seen}", _map_height(contact), _state_map
    return [
        ("pressure", *pressure, r"contact pressure $-\sigma_\nu$"),
        ("friction", *friction, r"friction traction $|\sigma_\tau|$"),
        ("states", *states),
    ]


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
        hidden = "_" if number else ""
        axes.plot(s, slip, color=style.VERMILION, lw=1.6, label=hidden + r"tangential $u_\tau$")
        axes.plot(s, distance, color=style.BLUE, lw=1.8, label=hidden + r"distance $g - u_\nu$")
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
    figure: Figure, contact: ContactPoints, facets: IntArray, values: FloatArray, label: str
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


_COLUMNS, _MOST = 3, 12


def adapt_charts(run: RunResults) -> list[Chart]:
    """The charts of a run with adapted meshes; none for other runs."""
    rows, found = adapted(run.summary), []
    if errors := _errors_of(rows):
        about = "Relative error over the number of unknowns, for each of the adapted meshes"
        tolerance = finite(run.summary["adapt"].get("tolerance"))
        found.append(chart("adapt-error", about, 3.0, _errors, errors, tolerance))
    if meshes := _meshes(run, rows):
        about, height = "The adapted meshes; coloured cells were marked", _height(meshes)
        found.append(chart("adapt-meshes", about, height, _multiples, meshes))
    return found


def adapted(summary: dict[str, Any]) -> list[dict[str, Any]]:
    """The entries ``adapt.meshes`` of a summary; empty without."""
    meshes: list[dict[str, Any]] = summary.get("adapt", {}).get("meshes", [])
    return meshes


def _errors_of(rows: list[dict[str, Any]]) -> list[tuple[float, float]]:
    """Unknowns and errors of the meshes that have both."""
    pairs = [(finite(row.get("dofs")), finite(row.get("estimate"))) for row in rows]
    return [(x, y) for x, y in pairs if x is not None and y is not None and x > 0.0 and y > 0.0]


def _errors(figure: Figure, errors: list[tuple[float, float]], tolerance: float | None) -> None:
    axes, label = figure.add_subplot(), "estimate, by recovery"
    axes.loglog(*zip(*errors, strict=True), color=style.BLUE, marker="o", ms=4, label=label)
    if tolerance is not None and tolerance > 0.0:
        dashes = (0, (5, 3))
        axes.axhline(tolerance, color=style.GREY, lw=1.0, ls=dashes, label="tolerance", zorder=0.5)
    axes.grid(visible=True, which="major", color=style.PALE, lw=0.6)
    axes.set_axisbelow(True)
    axes.set_xlabel("unknowns")
    axes.set_ylabel("relative error")
    axes.legend()


def _meshes(run: RunResults, rows: list[dict[str, Any]]) -> list[tuple[str, AdaptedMesh]]:
    """At most so many meshes as fit, with their titles."""
    try:
        meshes = [] if run.meshes is None else load(run.meshes)
    except InputError:
        return []
    pairs = list(zip(rows, meshes, strict=False))
    places = np.linspace(0, len(pairs) - 1, min(len(pairs), _MOST)).round().astype(int)
    return [(f"{pairs[at][0].get('dofs')} unknowns", pairs[at][1]) for at in places]


def _height(meshes: list[tuple[str, AdaptedMesh]]) -> float:
    extent = np.maximum(np.ptp(meshes[0][1].x, axis=0), 1e-300)
    shape = float(extent[1] / extent[0]) if len(extent) == 2 else 1.0
    lines = -(-len(meshes) // _COLUMNS)
    return lines * (WIDTH / _COLUMNS * min(max(shape, 0.2), 2.0) + 0.25)


def _multiples(figure: Figure, meshes: list[tuple[str, AdaptedMesh]]) -> None:
    places = figure.subplots(-(-len(meshes) // _COLUMNS), _COLUMNS, squeeze=False).ravel()
    for axes, (title, mesh) in zip(places, meshes, strict=False):
        draw_mesh(axes, mesh)
        axes.set_title(title, fontsize=8)
    for axes in places[len(meshes) :]:
        axes.set_axis_off()


# Towards the eye, for the surface of a body in 3D: from the front and from below, where contact is.
_TO_EYE = np.array([0.45, -0.8, -0.4])
# Edges of the finest meshes would cover their cells.
_WIDEST, _CELLS = 0.5, 600.0


def draw_mesh(axes: Axes, mesh: AdaptedMesh) -> None:
    """Draw the edges of a mesh; marked cells are coloured.

    The lines become an image, because a picture of all lines would be as large as the mesh.
    """
    x, triangles, marked = mesh.x, mesh.triangles, mesh.marked
    if mesh.dim == 3:
        eye = camera(x, _TO_EYE)
        order = np.argsort((x @ eye.towards)[triangles].mean(axis=1))
        x, triangles, marked = x @ np.array([eye.right, eye.up]).T, triangles[order], marked[order]
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
            _bars,
            own[:_MOST_BARS],
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
    return [chart("branches", about, 4.2, _branch, points, over)]


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
    about = f"Measured {names}, the model at the fitted numbers, and the residuals"
    return chart("fit", about, 0.5 + 2.9 * len(curves), _fit, curves)


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
