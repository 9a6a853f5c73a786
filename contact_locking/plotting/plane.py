"""The picture of a body in two dimensions."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch, Polygon
from matplotlib.path import Path

from contact_locking.plotting import profile, style
from contact_locking.plotting.foundation import touched
from contact_locking.plotting.snapshot import ContactMap, FloatArray, IntArray, Snapshot

# Thickness of the drawn foundation and its reach beyond Gamma_C, as shares of the body's size.
_THICKNESS, _REACH = 0.05, 0.08
_DASHES = (0, (4, 3))


def figure(body: Snapshot) -> Figure:
    """The deformed body over, if there is contact, the tractions along Gamma_C."""
    if body.contact is None:
        fig = Figure(figsize=(7.2, 5.6), layout="constrained")
        top = fig.add_subplot()
    else:
        fig = Figure(figsize=(7.2, 8.4), layout="constrained")
        top, middle, strip = fig.subplots(3, 1, height_ratios=(1.75, 1.0, 0.07))
        _tractions(middle, strip, body.contact)
    _body(fig, top, body)
    style.head(fig, body)
    return fig


def _body(fig: Figure, axes: Axes, body: Snapshot) -> None:
    factor = style.magnification(body)
    x = style.deformed(body, factor)
    shade = style.shade(body)
    handles: list[Patch | Line2D] = []
    triangles: Any = x[body.cells]
    colours = PolyCollection(
        triangles, cmap=shade.cmap, norm=shade.norm, edgecolors="face", linewidths=0.25
    )
    colours.set_array(shade.values)
    axes.add_collection(colours)
    if body.locked.any():
        handles.append(_locked_zone(axes, x, body))
    for outline in chains(body.boundary):
        axes.plot(*body.x[outline].T, color=style.GREY, lw=0.9, ls=_DASHES)
        axes.plot(*x[outline].T, color=style.BLACK, lw=1.1)
    handles.append(Line2D([], [], color=style.GREY, lw=0.9, ls=_DASHES, label="undeformed"))
    if body.contact is not None:
        handles.append(_foundation(axes, body.contact, factor, body.size))
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_title(f"Deformed body, {style.scale_words(factor)}", loc="left")
    axes.set_xlabel("$x$")
    axes.set_ylabel("$y$")
    bar = axes.inset_axes((1.03, 0.08, 0.025, 0.84))
    fig.colorbar(colours, cax=bar, label=shade.label, extend=shade.extend)
    # The distance to the axes is in font sizes, so that the labels fit at any height of the axes.
    axes.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        borderaxespad=4.0,
        ncols=len(handles),
    )


def _locked_zone(axes: Axes, x: FloatArray, body: Snapshot) -> Patch:
    """Hatch exactly the locked cells, and draw a smooth line around the zone they make up."""
    # One path of many triangles: Matplotlib hatches path by path, and takes its time for each.
    triangles = x[body.cells[body.locked]][:, [0, 1, 2, 0]].reshape(-1, 2)
    codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(triangles) // 4)
    path = Path(triangles, codes)
    axes.add_patch(PathPatch(path, facecolor="none", edgecolor=style.BLACK, hatch="////", lw=0.0))
    share = style.locked_share(body)
    for colour, width in (("white", 3.0), (style.VERMILION, 1.6)):
        axes.tricontour(
            *x.T, body.cells, share, levels=[style.RIM_SHARE], colors=[colour], linewidths=[width]
        )
    return Patch(
        facecolor="none",
        edgecolor=style.VERMILION,
        hatch="////",
        linewidth=1.6,
        label=style.LOCKED_LABEL,
    )


def _foundation(axes: Axes, contact: ContactMap, factor: float, size: float) -> Patch:
    """A hatched layer on the far side of the surface at Gamma_C + gap nu."""
    surface = touched(contact, factor)
    for chain in chains(contact.facets):
        line, normal = _extended(surface[chain], contact.points.normal[chain], _REACH * size)
        far = line + _THICKNESS * size * normal
        axes.add_patch(_layer(np.vstack([line, far[::-1]])))
        axes.plot(*line.T, color=style.BLACK, lw=1.4, solid_capstyle="butt", zorder=1.5)
    return Patch(facecolor=style.PALE, edgecolor=style.GREY, hatch="xxxx", label="foundation")


def _layer(outline: FloatArray) -> Patch:
    return Polygon(
        outline,
        facecolor=style.PALE,
        edgecolor=style.GREY,
        hatch="xxxx",
        linewidth=0.0,
        zorder=0.5,
    )


def _extended(line: FloatArray, normal: FloatArray, reach: float) -> tuple[FloatArray, FloatArray]:
    """A line prolonged along its end tangents; a closed one stays as it is."""
    if np.array_equal(line[0], line[-1]):
        return line, normal
    first, last = line[0] - line[1], line[-1] - line[-2]
    start = line[0] + reach * first / np.linalg.norm(first)
    end = line[-1] + reach * last / np.linalg.norm(last)
    return np.vstack([start, line, end]), np.vstack([normal[0], normal, normal[-1]])


def chains(segments: IntArray) -> list[IntArray]:
    """Segments (m, 2) as lines of point numbers; a closed line repeats its first point."""
    neighbours: dict[int, list[int]] = {}
    for a, b in segments:
        neighbours.setdefault(int(a), []).append(int(b))
        neighbours.setdefault(int(b), []).append(int(a))
    ends = [point for point, others in neighbours.items() if len(others) == 1]
    found = []
    for start in [*sorted(ends), *sorted(neighbours)]:
        if not neighbours[start]:
            continue
        line = [start]
        while neighbours[line[-1]]:
            following = neighbours[line[-1]].pop(0)
            neighbours[following].remove(line[-1])
            line.append(following)
        found.append(np.array(line))
    return found


def _tractions(axes: Axes, strip: Axes, contact: ContactMap) -> None:
    points = contact.points
    lines = chains(contact.facets)
    positions, label = profile.abscissa([points.x[line] for line in lines])
    tangent = np.column_stack([-points.normal[:, 1], points.normal[:, 0]])
    friction = np.sum(points.traction * tangent, axis=1)
    smoothed = np.abs(contact.smoothed)
    curves = [
        profile.Curve(
            s,
            points.pressure[line],
            friction[line],
            points.bound[line],
            points.state[line],
            smoothed[line],
        )
        for s, line in zip(positions, lines, strict=True)
    ]
    profile.draw(axes, strip, curves, label)
    axes.set_title(r"On the contact boundary $\Gamma_C$", loc="left")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
