"""The picture of a body in three dimensions: its surface, and Gamma_C seen from below."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d.art3d import (  # type: ignore[import-untyped]
    Line3DCollection,
    Poly3DCollection,
)

from contact_locking.plotting import style
from contact_locking.plotting.snapshot import ContactMap, FloatArray, Snapshot
from contact_locking.solution import SLIP

Place = tuple[float, float, float, float]

_AXES = "xyz"
_ELEVATION, _AZIMUTH = 18.0, -58.0
_MOST_ARROWS = 350
# From this ratio of the largest to the median pressure on its colours follow the square root.
_PEAKED = 6.0
# Towards the light, which only tells one face from the other.
_LIGHT = np.array([-0.35, -0.65, 0.68])
_SHADOW = 0.25
# Reach of the drawn foundation beyond Gamma_C as a share of the body's size.
_REACH = 0.12
# Points are in a plane if they leave it by less than this share of their extent.
_PLANE = 1e-6


def figure(body: Snapshot) -> Figure:
    """The deformed surface over, if there is contact, two maps of Gamma_C."""
    # Places are fixed: Matplotlib's layouts do not know how much of its box a 3D view fills.
    if body.contact is None:
        fig = Figure(figsize=(7.6, 6.4))
        _surface(fig, body, 0.02, 0.9)
    else:
        fig = Figure(figsize=(7.6, 9.6))
        _surface(fig, body, 0.42, 0.52)
        _pressure_map(fig, (0.08, 0.1, 0.37, 0.27), body.contact)
        _state_map(fig, (0.58, 0.1, 0.37, 0.27), body.contact)
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
        foundation = _foundation(body.contact, factor, body.size)
        extent = np.vstack([x, foundation.reshape(-1, 3)])
        edge = style.GREY if len(foundation) == 1 else style.PALE
        axes.add_collection3d(
            Poly3DCollection(foundation, facecolors=style.PALE, edgecolors=edge, linewidths=0.6)
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


def _foundation(contact: ContactMap, factor: float, size: float) -> FloatArray:
    """The surface at Gamma_C + gap nu: its facets, or one rectangle around it if it is plane."""
    points = contact.points
    surface = points.x + factor * points.gap[:, None] * points.normal
    centre = surface.mean(axis=0)
    _, spread, basis = np.linalg.svd(surface - centre, full_matrices=False)
    if spread[2] > _PLANE * spread[0]:
        return surface[contact.facets]
    # Along the axes of coordinates where the plane allows it.
    first = np.eye(3)[np.argmin(np.abs(basis[2]))]
    first = first - (first @ basis[2]) * basis[2]
    first /= np.linalg.norm(first)
    frame = np.array([first, np.cross(basis[2], first)])
    flat = (surface - centre) @ frame.T
    low, high = flat.min(axis=0) - _REACH * size, flat.max(axis=0) + _REACH * size
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    return (centre + corners @ frame)[None]


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


def _pressure_map(fig: Figure, place: Place, contact: ContactMap) -> None:
    points = contact.points
    axes, i, j = _map_from_below(fig, place, points.normal)
    x, y = points.x[:, i], points.x[:, j]
    # A peak at a corner would leave all else in the dark.
    touching = points.pressure[points.pressure > 0.0]
    peaked = len(touching) > 0 and touching.max() > _PEAKED * np.median(touching)
    norm = PowerNorm(0.5 if peaked else 1.0, vmin=0.0, vmax=touching.max(initial=0.0) or 1.0)
    colours = axes.tripcolor(
        x, y, contact.facets, points.pressure, shading="gouraud", cmap="cividis", norm=norm
    )
    axes.margins(0.0)
    bar = fig.add_axes((place[0] + 0.02, 0.045, place[2] - 0.04, 0.01))
    fig.colorbar(colours, cax=bar, orientation="horizontal")
    bar.locator_params(nbins=5)
    title = r"Contact pressure $-\sigma_\nu$"
    slips = np.flatnonzero(points.state == SLIP)
    if len(slips):
        shown = slips[:: -(-len(slips) // _MOST_ARROWS)]
        slip = points.u_tangent[shown]
        axes.quiver(
            x[shown],
            y[shown],
            slip[:, i],
            slip[:, j],
            angles="xy",
            color="white",
            edgecolor=style.BLACK,
            linewidth=0.4,
            width=0.008,
        )
        title += ", arrows: slip"
    axes.set_title(title, loc="left")


def _state_map(fig: Figure, place: Place, contact: ContactMap) -> None:
    """Around each point the part of Gamma_C that is nearer to it than to other corners."""
    points = contact.points
    axes, i, j = _map_from_below(fig, place, points.normal)
    corners = points.x[contact.facets][:, :, [i, j]]
    centre = corners.mean(axis=1)
    quads = [
        np.stack(
            [
                corners[:, k],
                0.5 * (corners[:, k] + corners[:, (k + 1) % 3]),
                centre,
                0.5 * (corners[:, k] + corners[:, (k + 2) % 3]),
            ],
            axis=1,
        )
        for k in range(3)
    ]
    state = points.state[contact.facets].T.ravel()
    parts = PolyCollection(
        np.concatenate(quads), cmap=style.STATES, edgecolors="face", linewidths=0.2
    )
    parts.set_array(state)
    parts.set_clim(-0.5, 2.5)
    axes.add_collection(parts)
    axes.autoscale_view()
    axes.margins(0.0)
    axes.set_title("State", loc="left")
    fig.legend(handles=style.state_patches(), loc="center", bbox_to_anchor=(0.77, 0.05), ncols=3)


def _map_from_below(fig: Figure, place: Place, normals: FloatArray) -> tuple[Axes, int, int]:
    """A map of Gamma_C with its two axes, oriented as one sees it from the foundation."""
    normal = normals.mean(axis=0)
    across = int(np.argmax(np.abs(normal)))
    i, j = (axis for axis in range(3) if axis != across)
    axes = fig.add_axes(place, aspect="equal", anchor="S")
    axes.set_xlabel(f"${_AXES[i]}$")
    axes.set_ylabel(f"${_AXES[j]}$")
    # Right times up points at the viewer, who is where the normal points.
    upright = np.cross(np.eye(3)[i], np.eye(3)[j]) @ normal
    axes.yaxis.set_inverted(bool(upright < 0.0))
    return axes, i, j
