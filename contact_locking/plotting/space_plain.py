"""The picture of a body in three dimensions by Matplotlib alone, where VTK cannot draw."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d.art3d import (  # type: ignore[import-untyped]
    Line3DCollection,
    Poly3DCollection,
)

from contact_locking.arrays import AXES, FloatArray
from contact_locking.plotting import contact_map, style
from contact_locking.plotting.film_look import Look
from contact_locking.plotting.ground import foundation, tool
from contact_locking.plotting.snapshot import Snapshot

# Inches: the deformed surface with the head of the figure, and the maps of a contact.
_TOP, _ROW = 5.568, 4.032
_ELEVATION, _AZIMUTH = 18.0, -58.0
# The direction to the light, which tells the faces of the body apart.
_LIGHT = np.array([-0.35, -0.65, 0.68])
_SHADOW = 0.25


def figure(body: Snapshot) -> Figure:
    """The deformed surface, and below it two maps of each contact."""
    contacts = body.contact.parts()
    # Places are fixed: Matplotlib's layouts do not know how much of its box a 3D view fills.
    if not contacts:
        fig = Figure(figsize=(7.6, 6.4))
        _deformed(fig, body, 0.02, 0.9)
    else:
        height = _TOP + _ROW * len(contacts)
        fig = Figure(figsize=(7.6, height))
        _deformed(fig, body, 1.0 - _TOP / height, 4.992 / height)
        for number, contact in enumerate(contacts, start=1):
            low = (height - _TOP - number * _ROW) / height
            bottom, tall = low + 0.96 / height, 2.592 / height
            bar = (0.1, low + 0.432 / height, 0.33, 0.096 / height)
            contact_map.pressure_map(fig, (0.08, bottom, 0.37, tall), bar, contact)
            contact_map.state_map(fig, (0.58, bottom, 0.37, tall), contact)
            anchor = (0.77, low + 0.48 / height)
            states = style.state_patches()
            fig.legend(handles=states, loc="center", bbox_to_anchor=anchor, ncols=3)
    style.head(fig, body)
    return fig


def frames(bodies: Sequence[Snapshot], look: Look, titles: Sequence[str]) -> Iterator[Figure]:
    """The pictures of an animation."""
    extent = _extent(bodies, look.factor)
    for body, shade, title in zip(bodies, look.shades, titles, strict=True):
        fig = Figure(figsize=(6.4, 5.2))
        _surface(fig, body, 0.03, 0.9, look.factor, shade, extent)
        fig.text(0.03, 0.95, title, fontsize=10.5, parse_math=False)
        yield fig


def _deformed(fig: Figure, body: Snapshot, bottom: float, height: float) -> None:
    factor = style.magnification(body)
    extent = _extent([body], factor)
    handles = _surface(fig, body, bottom, height, factor, style.shade(body), extent)
    title = f"Deformed body, {style.scale_words(factor)}"
    fig.text(0.08, bottom + height - 0.02, title, fontsize=10.5)
    fig.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.065, bottom + height - 0.025))


def _extent(bodies: Sequence[Snapshot], factor: float) -> FloatArray:
    """The least and the greatest coordinates (2, 3) of bodies and their foundations."""
    places = []
    for body in bodies:
        places.append(style.deformed(body, factor))
        for contact in body.contact.parts():
            places.append(foundation(contact, factor, body.size).reshape(-1, 3))
    low, high = (end([end(place, axis=0) for place in places], axis=0) for end in (np.min, np.max))
    return np.stack([low, high])


def _surface(
    fig: Figure,
    body: Snapshot,
    bottom: float,
    height: float,
    factor: float,
    shade: style.Shade,
    extent: FloatArray,
) -> list[Patch | Line2D]:
    """Draw the deformed body and its foundations; returns what a legend explains."""
    axes: Any = fig.add_axes((0.0, bottom, 0.86, height), projection="3d")
    # Matplotlib draws collections in the order in which they are added: it hides none by depth.
    axes.computed_zorder = False
    axes.view_init(elev=_ELEVATION, azim=_AZIMUTH)
    x = style.deformed(body, factor)
    handles: list[Patch | Line2D] = []
    for contact in body.contact.parts():
        ground = foundation(contact, factor, body.size)
        edge = style.GREY if len(ground) == 1 else style.PALE
        alpha = style.TOOL_OPACITY if len(tool(contact, factor)) else None
        look: dict[str, Any] = {"facecolors": style.PALE, "edgecolors": edge, "linewidths": 0.6}
        axes.add_collection3d(Poly3DCollection(ground, alpha=alpha, **look))
    if len(body.contact.points):
        handles.append(Patch(facecolor=style.PALE, edgecolor=style.GREY, label="foundation"))
    normals = _outward(x[body.boundary], x[body.cells[body.boundary_cell]].mean(axis=1))
    visible = normals @ _towards_viewer() > 0.0
    faces = x[body.boundary[visible]]
    colours = shade.cmap(shade.norm(shade.values[body.boundary_cell[visible]]))
    lit = np.clip(normals[visible] @ _LIGHT, 0.0, 1.0)
    colours[:, :3] *= (1.0 - _SHADOW * (1.0 - lit))[:, None]
    axes.add_collection3d(
        Poly3DCollection(faces, facecolors=colours, edgecolors=colours, linewidths=0.3)
    )
    if body.locked.any():
        rim = _level_lines(faces, style.locked_share(body)[body.boundary[visible]])
        for colour, width in (("white", 2.6), (style.VERMILION, 1.5)):
            axes.add_collection3d(Line3DCollection(rim, colors=colour, linewidths=width))
        handles.append(Line2D([], [], color=style.VERMILION, lw=1.5, label=style.RIM_LABEL))
    _frame(axes, extent)
    bar = fig.add_axes((0.88, bottom + 0.2 * height, 0.018, 0.6 * height))
    fig.colorbar(
        ScalarMappable(shade.norm, shade.cmap), cax=bar, label=shade.label, extend=shade.extend
    )
    return handles


def _outward(faces: FloatArray, inside: FloatArray) -> FloatArray:
    """Unit normals (b, 3) of triangles (b, 3, 3) that point away from ``inside`` (b, 3)."""
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    outwards = np.sum(normals * (faces[:, 0] - inside), axis=1, keepdims=True)
    return np.where(outwards < 0.0, -normals, normals) / np.where(length > 0.0, length, 1.0)


def _towards_viewer() -> FloatArray:
    up, around = np.radians([_ELEVATION, _AZIMUTH])
    return np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])


def _level_lines(faces: FloatArray, values: FloatArray) -> FloatArray:
    """Segments (m, 2, 3) on which functions given at corners of triangles are RIM_SHARE."""
    above = values >= style.RIM_SHARE
    crossed = above.any(axis=1) & ~above.all(axis=1)
    faces, values, above = faces[crossed], values[crossed], above[crossed]
    # The segment cuts both edges at the corner that is alone on its side of the level.
    alone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    rows = np.arange(len(faces))
    ends = []
    for step in (1, 2):
        other = (alone + step) % 3
        start, end = values[rows, alone], values[rows, other]
        share = ((style.RIM_SHARE - start) / (end - start))[:, None]
        ends.append((1.0 - share) * faces[rows, alone] + share * faces[rows, other])
    return np.stack(ends, axis=1)


def _frame(axes: Any, extent: FloatArray) -> None:
    """Show a box (2, 3) at equal scales, with three arrows at a lower corner instead of axes."""
    low, high = extent
    arrow = 0.14 * float((high - low).max())
    axes.set_axis_off()
    limits = zip(AXES, low, high, strict=True)
    axes.set(**{f"{name}lim": (a, b) for name, a, b in limits})
    axes.set_box_aspect(high - low, zoom=1.15)
    for name, direction in zip(AXES, arrow * np.eye(3), strict=True):
        line = np.array([low, low + direction])
        axes.plot(*line.T, color=style.BLACK, lw=1.2, clip_on=False)
        axes.text(*(low + 1.35 * direction), f"${name}$", ha="center", va="center")
