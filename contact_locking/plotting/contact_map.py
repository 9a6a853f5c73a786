"""Maps of Gamma_C in three dimensions, seen from the foundation."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection, TriMesh
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure

from contact_locking.plotting import style
from contact_locking.plotting.snapshot import ContactMap, FloatArray, IntArray
from contact_locking.solution import SLIP, ContactPoints

Place = tuple[float, float, float, float]

PRESSURE_TITLE, PRESSURE_COLOURS = r"Contact pressure $-\sigma_\nu$", "cividis"

_AXES = "xyz"
# At most so many arrows beside each other.
_ARROWS = 12
# From this ratio of the largest to the median pressure on its colours follow the square root.
_PEAKED = 6.0


def pressure_norm(points: ContactPoints) -> Normalize:
    """The scale of colours for the pressure."""
    # A peak at a corner would leave all else in the dark.
    touching = points.pressure[points.pressure > 0.0]
    peaked = len(touching) > 0 and touching.max() > _PEAKED * np.median(touching)
    return PowerNorm(0.5 if peaked else 1.0, vmin=0.0, vmax=touching.max(initial=0.0) or 1.0)


def slipping(points: ContactPoints) -> IntArray:
    """The points that slip, of many in one place one."""
    slips = np.flatnonzero(points.state == SLIP)
    places = points.x[slips] * (_ARROWS / float(np.ptp(points.x, axis=0).max()))
    boxes = np.floor(places)
    # Of the points in a box the one that is most in the middle.
    order = np.argsort(np.linalg.norm(places - boxes - 0.5, axis=1))
    first = np.unique(boxes[order], axis=0, return_index=True)[1]
    return slips[np.sort(order[first])]


def arrows(axes: Axes, tails: FloatArray, directions: FloatArray) -> None:
    """Arrows of the slip at ``tails`` (k, 2), as long as ``directions`` (k, 2) in proportion."""
    axes.quiver(
        *tails.T,
        *directions.T,
        angles="xy",
        color="white",
        edgecolor=style.BLACK,
        linewidth=0.4,
        width=0.008,
    )


def pressure_map(fig: Figure, place: Place, contact: ContactMap) -> None:
    """The pressure in colours with arrows of the slip, and the scale below."""
    points = contact.points
    axes = fig.add_axes(place, aspect="equal", anchor="S")
    colours = colour_values(
        axes,
        points,
        contact.facets,
        points.pressure,
        cmap=PRESSURE_COLOURS,
        norm=pressure_norm(points),
    )
    bar = fig.add_axes((place[0] + 0.02, 0.045, place[2] - 0.04, 0.01))
    fig.colorbar(colours, cax=bar, orientation="horizontal")
    bar.locator_params(nbins=5)
    shown = slipping(points)
    if len(shown):
        i, j, _ = frame(points)
        arrows(axes, points.x[shown][:, [i, j]], points.u_tangent[shown][:, [i, j]])
    axes.set_title(PRESSURE_TITLE + (", arrows: slip" if len(shown) else ""), loc="left")


def state_map(fig: Figure, place: Place, contact: ContactMap) -> None:
    """The states, without a scale."""
    axes = fig.add_axes(place, aspect="equal", anchor="S")
    colour_states(axes, contact.points, contact.facets)
    axes.set_title("State", loc="left")


def colour_values(
    axes: Axes, points: ContactPoints, facets: IntArray, values: FloatArray, **look: Any
) -> TriMesh:
    """Values at the points in colours that go over into each other."""
    i, j = _orient(axes, points)
    flat = points.x[:, i], points.x[:, j]
    colours = axes.tripcolor(*flat, facets, values, shading="gouraud", **look)
    axes.margins(0.0)
    return colours


def colour_states(axes: Axes, points: ContactPoints, facets: IntArray, **look: Any) -> None:
    """Around each point the part of Gamma_C that is nearer to it than to other corners."""
    shapes, point = nearest_parts(points.x[:, _orient(axes, points)], facets)
    parts = PolyCollection(
        list(shapes), cmap=style.STATES, edgecolors="face", linewidths=0.2, **look
    )
    parts.set_array(points.state[point])
    parts.set_clim(-0.5, 2.5)
    axes.add_collection(parts)
    axes.autoscale_view()
    axes.margins(0.0)


def nearest_parts(x: FloatArray, facets: IntArray) -> tuple[FloatArray, IntArray]:
    """Each facet (m, d) of points x (k, e) in d parts, a corner in each: shapes, and the corners.

    Shapes are quadrilaterals (d m, 4, e) of triangles, or halves (d m, 2, e) of segments.
    """
    corners = x[facets]
    number = facets.shape[1]
    centre = corners.mean(axis=1)
    shapes = []
    for k in range(number):
        middles = [0.5 * (corners[:, k] + corners[:, (k + s) % number]) for s in (1, 2)]
        outline = [corners[:, k], middles[0], centre, middles[1]]
        shapes.append(np.stack(outline if number == 3 else [corners[:, k], centre], axis=1))
    return np.concatenate(shapes), facets.T.ravel()


def frame(points: ContactPoints) -> tuple[int, int, bool]:
    """The two axes of a map that shows Gamma_C from the foundation; whether the second points down.

    One looks against the mean normal.
    """
    normal = points.normal.mean(axis=0)
    across = int(np.argmax(np.abs(normal)))
    i, j = (axis for axis in range(3) if axis != across)
    # Right times up points at the viewer, who is where the normal points.
    return i, j, bool(np.cross(np.eye(3)[i], np.eye(3)[j]) @ normal < 0.0)


def _orient(axes: Axes, points: ContactPoints) -> list[int]:
    """Make ``axes`` such a map; its two axes."""
    i, j, downwards = frame(points)
    axes.set_xlabel(f"${_AXES[i]}$")
    axes.set_ylabel(f"${_AXES[j]}$")
    axes.yaxis.set_inverted(downwards)
    return [i, j]
