"""The picture of a body in three dimensions by Matplotlib alone, where VTK cannot draw."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d.art3d import (  # type: ignore[import-untyped]
    Line3DCollection,
    Poly3DCollection,
)

from contact_locking.plotting import contact_map, style
from contact_locking.plotting.foundation import foundation
from contact_locking.plotting.snapshot import FloatArray, Snapshot

_AXES = "xyz"
_ELEVATION, _AZIMUTH = 18.0, -58.0
# Towards the light, which only tells one face from the other.
_LIGHT = np.array([-0.35, -0.65, 0.68])
_SHADOW = 0.25


def figure(body: Snapshot) -> Figure:
    """The deformed surface over, if there is contact, two maps of Gamma_C."""
    # Places are fixed: Matplotlib's layouts do not know how much of its box a 3D view fills.
    if body.contact is None:
        fig = Figure(figsize=(7.6, 6.4))
        _surface(fig, body, 0.02, 0.9)
    else:
        fig = Figure(figsize=(7.6, 9.6))
        _surface(fig, body, 0.42, 0.52)
        contact_map.pressure_map(fig, (0.08, 0.1, 0.37, 0.27), body.contact)
        contact_map.state_map(fig, (0.58, 0.1, 0.37, 0.27), body.contact)
        states = style.state_patches()
        fig.legend(handles=states, loc="center", bbox_to_anchor=(0.77, 0.05), ncols=3)
    style.head(fig, body)
    return fig


def _surface(fig: Figure, body: Snapshot, bottom: float, height: float) -> None:
    axes: Any = fig.add_axes((0.0, bottom, 0.86, height), projection="3d")
    # Matplotlib cannot hide one collection behind another; the order they are added in does.
    axes.computed_zorder = False
    axes.view_init(elev=_ELEVATION, azim=_AZIMUTH)
    factor = style.magnification(body)
    x = style.deformed(body, factor)
    shade = style.shade(body)
    handles, extent = [], x
    if body.contact is not None:
        ground = foundation(body.contact, factor, body.size)
        extent = np.vstack([x, ground.reshape(-1, 3)])
        edge = style.GREY if len(ground) == 1 else style.PALE
        axes.add_collection3d(
            Poly3DCollection(ground, facecolors=style.PALE, edgecolors=edge, linewidths=0.6)
        )
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
        full = shade.cmap(shade.norm(1.0))
        handles.append(
            Patch(facecolor=full, edgecolor=style.VERMILION, lw=1.5, label=style.LOCKED_LABEL)
        )
    _frame(axes, extent)
    title = f"Deformed body, {style.scale_words(factor)}"
    fig.text(0.08, bottom + height - 0.02, title, fontsize=10.5)
    fig.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.065, bottom + height - 0.025))
    bar = fig.add_axes((0.88, bottom + 0.2 * height, 0.018, 0.6 * height))
    fig.colorbar(
        ScalarMappable(shade.norm, shade.cmap), cax=bar, label=shade.label, extend=shade.extend
    )


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
    """Segments (m, 2, 3) where linear functions on triangles, given at corners, cross the rim."""
    above = values >= style.RIM_SHARE
    crossed = above.any(axis=1) & ~above.all(axis=1)
    faces, values, above = faces[crossed], values[crossed], above[crossed]
    # The corner that is alone on its side; the line cuts both edges at it.
    alone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    rows = np.arange(len(faces))
    ends = []
    for step in (1, 2):
        other = (alone + step) % 3
        start, end = values[rows, alone], values[rows, other]
        share = ((style.RIM_SHARE - start) / (end - start))[:, None]
        ends.append((1.0 - share) * faces[rows, alone] + share * faces[rows, other])
    return np.stack(ends, axis=1)


def _frame(axes: Any, x: FloatArray) -> None:
    """Equal scales around the points, and instead of axes three arrows at a lower corner."""
    low, high = x.min(axis=0), x.max(axis=0)
    arrow = 0.14 * float((high - low).max())
    axes.set_axis_off()
    limits = zip(_AXES, low, high, strict=True)
    axes.set(**{f"{name}lim": (a, b) for name, a, b in limits})
    axes.set_box_aspect(high - low, zoom=1.15)
    for name, direction in zip(_AXES, arrow * np.eye(3), strict=True):
        line = np.array([low, low + direction])
        axes.plot(*line.T, color=style.BLACK, lw=1.2, clip_on=False)
        axes.text(*(low + 1.35 * direction), f"${name}$", ha="center", va="center")
