"""The picture of a body in two dimensions."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import TriMesh
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch, Polygon
from matplotlib.path import Path
from matplotlib.tri import Triangulation

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.results.contact_points import ContactPoints, curves
from contact_locking.view.pictures import style
from contact_locking.view.pictures.style import ContactMap, Snapshot, tool, touched

_MOST_MARKERS = 60
# A contact whose tractions are a smaller share than this of the largest one is open.
_UNTOUCHED = 1e-6
# The numbers of characters of a contact's name in a title.
_LONGEST_NAME = 40


def draw_tractions(
    axes: Axes,
    strip: Axes,
    points: ContactPoints,
    facets: IntArray,
    units: style.Units,
    largest: float,
    smoothed: FloatArray | None = None,
) -> None:
    """Draw the tractions along a contact into ``axes``, the states into the narrow ``strip`` below.

    ``largest`` is the largest traction on all of Gamma_C.  Tractions that the method leaves where
    a contact is open are flat beside it.  ``smoothed`` (k,) is R sigma_nu.
    """
    lines = curves(facets)
    positions, label = abscissa([points.x[line] for line in lines], units)
    for number, (s, line) in enumerate(zip(positions, lines, strict=True)):
        hidden = "_" if number else ""  # so that the legend has each name once
        bound, pressure = points.bound[line], points.pressure[line]
        friction = along(points.traction[line], points.x[line], s)
        name = hidden + r"friction bound $\pm\mu\,|R\sigma_\nu|$"
        axes.fill_between(s, -bound, bound, color=style.ORANGE, alpha=0.22, lw=0.0, label=name)
        name = hidden + r"contact pressure $-\sigma_\nu$"
        axes.plot(s, pressure, color=style.BLUE, lw=1.8, label=name)
        if smoothed is not None:
            name = hidden + r"smoothed $|R\sigma_\nu|$"
            values = np.abs(smoothed[line])
            axes.plot(s, values, color=style.BLACK, lw=1.2, ls=(0, (5, 2)), label=name)
        name = hidden + r"friction traction $\sigma_\tau$"
        marker = "o" if len(s) <= _MOST_MARKERS else ""
        axes.plot(s, friction, color=style.VERMILION, lw=1.6, marker=marker, ms=2.2, label=name)
        # Each state from the middle before to the middle after its point.
        edges = np.concatenate([s[:1], 0.5 * (s[1:] + s[:-1]), s[-1:]])
        states = points.state[None, line]
        strip.pcolormesh(edges, [0.0, 1.0], states, cmap=style.STATES, vmin=-0.5, vmax=2.5)
    all_values = (points.pressure, points.bound, points.traction)
    if max(np.abs(values).max() for values in all_values) < _UNTOUCHED * largest:
        axes.set_ylim(-0.5 * largest, largest)
    axes.axhline(0.0, color=style.GREY, lw=0.7, zorder=0.5)
    axes.set_ylabel(style.labelled("traction", "stress", units))
    style.power_beside(axes)
    axes.tick_params(labelbottom=False)
    axes.margins(x=0.0)
    strip.sharex(axes)
    strip.set_yticks([])
    strip.set_xlabel(label, loc="left")
    strip.set_ylabel("state", rotation=0, ha="right", va="center")
    strip.spines[["left", "bottom"]].set_visible(False)
    where: dict[str, Any] = {"loc": "upper right", "bbox_to_anchor": (1.0, 0.0)}
    strip.legend(handles=style.state_patches(), borderaxespad=2.2, ncols=3, **where)


def abscissa(lines: Sequence[FloatArray], units: style.Units) -> tuple[list[FloatArray], str]:
    """The places of the points (k, 2) of each line along an axis, and the label of that axis.

    The places are x, where x is monotone and lines do not overlap, otherwise y, otherwise arc
    length.
    """
    for axis, name in enumerate("xy"):
        along = [line[:, axis] for line in lines]
        steps = [np.diff(s) for s in along]
        monotone = all((step > 0).all() or (step < 0).all() for step in steps)
        ends = itertools.pairwise(sorted((s.min(), s.max()) for s in along))
        if monotone and not any(second[0] < first[1] for first, second in ends):
            return along, style.labelled(f"${name}$", "length", units)
    position: list[FloatArray] = []
    start = 0.0
    for line in lines:
        lengths = np.linalg.norm(np.diff(line, axis=0), axis=1)
        position.append(start + np.concatenate([[0.0], np.cumsum(lengths)]))
        # The next line begins after a small distance.
        start = float(position[-1][-1] + 0.1 * lengths.sum())
    return position, style.labelled(r"arc length along $\Gamma_C$", "length", units)


def along(vectors: FloatArray, x: FloatArray, s: FloatArray) -> FloatArray:
    """The components (k,) of vectors along a curve, towards where the abscissa ``s`` grows."""
    tangent = np.gradient(x, axis=0)
    length = np.linalg.norm(tangent, axis=1)
    direction = 1.0 if s[-1] >= s[0] else -1.0
    # At the tip of a slit the points before and after may be at one place.
    return direction * np.sum(vectors * tangent, axis=1) / np.where(length > 0.0, length, 1.0)


# Thickness of the drawn foundation and its reach beyond Gamma_C, as shares of the body's size.
_THICKNESS, _REACH = 0.05, 0.08
_DASHES = (0, (4, 3))
# In inches: the width of a picture, the limits of the height of the body, and the room for words on
# the left of axes, on the right of the body, above and below axes.
_SHEET, _LOWEST, _HIGHEST = 7.2, 0.8, 3.4
_LEFT, _RIGHT, _TITLE, _BELOW, _LEGEND = 0.95, 1.15, 0.35, 0.5, 0.35
# The heights of the tractions on a contact, of the states, and of the space between them.
_TRACTIONS, _STATES, _BETWEEN = 1.9, 0.13, 0.13
# The free space around the body and its tools, and how far beside the body tools are shown, as
# shares of the size.
_MARGIN, _BESIDE = 0.06, 0.25


def figure(body: Snapshot, units: style.Units) -> Figure:
    """The deformed body, and below it a panel with the tractions along each contact."""
    contacts, factor = body.contact.parts(), style.magnification(body)
    width, top = _SHEET - _LEFT - _RIGHT, style.HEAD + _TITLE
    across, up = _window(body, factor)
    height = float(np.clip(width * up / across, _LOWEST, _HIGHEST))
    first = top + height + _BELOW + _LEGEND
    each = _LEGEND + _TITLE + _TRACTIONS + _BETWEEN + _STATES + _BELOW
    fig = Figure(figsize=(_SHEET, first + each * len(contacts)))
    style.head(fig, body)
    axes = style.panel(fig, _LEFT, top, width, height)
    handles = _deformed(fig, axes, body, factor)
    x_label, y_label = (style.labelled(name, "length", units) for name in ("$x$", "$y$"))
    axes.set(xlabel=x_label, ylabel=y_label)
    axes.autoscale_view()
    axes.set_title(f"Deformed body, {style.scale_words(factor)}", loc="left")
    # A distance in font sizes leaves room for the labels at any height of the axes.
    where: dict[str, Any] = {"bbox_to_anchor": (0.5, 0.0), "borderaxespad": 4.0}
    axes.legend(handles=handles, loc="upper center", ncols=len(handles), **where)
    largest = float(body.contact.points.pressure.max(initial=0.0))
    for number, contact in enumerate(contacts):
        top = first + number * each + _LEGEND + _TITLE
        width = _SHEET - _LEFT - _RIGHT / 4
        axes = style.panel(fig, _LEFT, top, width, _TRACTIONS)
        strip = style.panel(fig, _LEFT, top + _TRACTIONS + _BETWEEN, width, _STATES)
        draw_tractions(
            axes, strip, contact.points, contact.facets, units, largest, contact.smoothed
        )
        title = r"On the contact boundary $\Gamma_C$"
        if name := contact.names[0]:
            # A name leaves the title less room beside the legend.
            short = name if len(name) <= _LONGEST_NAME else f"{name[: _LONGEST_NAME - 1]}\u2026"
            # Matplotlib would begin a formula at a dollar sign.
            title = r"On $\Gamma_C$: " + short.replace("$", r"\$")
        axes.set_title(title, loc="left")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    return fig


def _window(body: Snapshot, factor: float) -> FloatArray:
    """The width and height of a window with the deformed body and the foundations near it."""
    places = style.deformed(body, factor)
    low, high = places.min(axis=0), places.max(axis=0)
    beside = _BESIDE * float((high - low).max())
    tools = [tool(contact, factor) for contact in body.contact.parts()]
    points = np.concatenate([places[:0], *(segments.reshape(-1, 2) for segments in tools)])
    near = points[np.all((points >= low - beside) & (points <= high + beside), axis=1)]
    extent = np.ptp(np.vstack([low, high, near]), axis=0)
    return extent + 2.0 * _MARGIN * extent.max()


def _deformed(fig: Figure, axes: Axes, body: Snapshot, factor: float) -> list[Patch | Line2D]:
    """Draw the body, its locked zone and the foundation; returns the entries of the legend."""
    shade, x = style.shade(body), style.deformed(body, factor)
    # Corners of one colour: Matplotlib draws polygons, each of them a path, more slowly.
    corners = np.arange(body.cells.size).reshape(-1, 3)
    mesh = Triangulation(*x[body.cells].reshape(-1, 2).T, corners)
    colours = TriMesh(mesh, cmap=shade.cmap, norm=shade.norm)
    colours.set_array(shade.values.repeat(3))
    axes.add_collection(colours, autolim=False)
    axes.update_datalim(x)
    handles = _locked_zone(axes, x, body) if body.locked.any() else []
    for outline in curves(body.boundary):
        axes.plot(*body.x[outline].T, color=style.GREY, lw=0.9, ls=_DASHES)
        axes.plot(*x[outline].T, color=style.BLACK, lw=1.1)
    handles.append(Line2D([], [], color=style.GREY, lw=0.9, ls=_DASHES, label="undeformed"))
    if body.contact.on_foundations():
        handles.append(_foundation(axes, body.contact, factor, body.size))
    axes.set_aspect("equal")
    bar = axes.inset_axes((1.03, 0.08, 0.025, 0.84))
    fig.colorbar(colours, cax=bar, label=shade.label, extend=shade.extend)
    return handles


def _locked_zone(axes: Axes, x: FloatArray, body: Snapshot) -> list[Patch | Line2D]:
    """Hatch exactly the locked cells, and draw a smooth line around the zone of locked cells."""
    # All triangles are in one path, as Matplotlib hatches each path for itself, which takes time.
    triangles = x[body.cells[body.locked]][:, [0, 1, 2, 0]].reshape(-1, 2)
    codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(triangles) // 4)
    path = Path(triangles, codes)
    hatched = PathPatch(path, facecolor="none", edgecolor=style.BLACK, hatch="////", lw=0.0)
    axes.add_artist(hatched)  # add_patch would look for the extent of each triangle
    share = style.locked_share(body)
    for colour, width in (("white", 3.0), (style.VERMILION, 1.6)):
        axes.tricontour(
            *x.T, body.cells, share, levels=[style.RIM_SHARE], colors=[colour], linewidths=[width]
        )
    rim = Line2D([], [], color=style.VERMILION, lw=1.6, label="edge of the limit zone")
    look: dict[str, Any] = {"facecolor": "none", "edgecolor": style.BLACK, "linewidth": 0.6}
    # The cells that the number of a summary counts.
    label = r"cells at the limit, $|\varepsilon| \geq M$"
    return [Patch(label=label, hatch="////", **look), rim]


def _foundation(axes: Axes, contact: ContactMap, factor: float, size: float) -> Patch:
    look: dict[str, Any] = {"facecolor": style.PALE, "edgecolor": style.GREY, "hatch": "xxxx"}
    for touching in contact.on_foundations():
        segments = tool(touching, factor)
        drawn = _tools(segments, size) if len(segments) else _ground(touching, factor, size)
        for line, outline in drawn:
            axes.add_patch(Polygon(outline, linewidth=0.0, zorder=0.5, **look))
            axes.plot(*line.T, color=style.BLACK, lw=1.4, solid_capstyle="butt", zorder=1.5)
    return Patch(label="foundation", **look)


def _tools(segments: FloatArray, size: float) -> Iterator[tuple[FloatArray, FloatArray]]:
    """The lines of the segments (m, 2, 2), and polygons, or layers on the left of open lines."""
    breaks = 1 + np.flatnonzero(np.any(segments[1:, 0] != segments[:-1, 1], axis=1))
    for piece in np.split(segments, breaks):
        line = np.vstack([piece[:, 0], piece[-1:, 1]])
        outline = line
        if not np.array_equal(line[0], line[-1]):
            along = np.gradient(line, axis=0)
            along /= np.linalg.norm(along, axis=1)[:, None]
            left = np.stack([-along[:, 1], along[:, 0]], axis=1)
            outline = np.vstack([line, (line + _THICKNESS * size * left)[::-1]])
        yield line, outline


def _ground(
    contact: ContactMap, factor: float, size: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """The lines of the foundation below Gamma_C, and the layers below them.

    A line that is not closed is prolonged along its end tangents.
    """
    surface = touched(contact, factor)
    for curve in curves(contact.facets):
        line, normal = surface[curve], contact.points.normal[curve]
        if not np.array_equal(line[0], line[-1]):
            ends = np.array([line[0] - line[1], line[-1] - line[-2]])
            reach = _REACH * size / np.linalg.norm(ends, axis=1)[:, None]
            start, end = line[[0, -1]] + reach * ends
            line, normal = np.vstack([start, line, end]), normal[[0, *range(len(line)), -1]]
        yield line, np.vstack([line, (line + _THICKNESS * size * normal)[::-1]])
