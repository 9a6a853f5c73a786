"""Maps of one contact in three dimensions, seen from the foundation."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection, TriMesh
from matplotlib.colors import Normalize, PowerNorm

from contact_locking.arrays import AXES, FloatArray, IntArray
from contact_locking.results.contact_points import SLIP, ContactPoints
from contact_locking.view.pictures import style

PRESSURE_COLOURS = "cividis"

# The largest number of arrows in a row.
_ARROWS = 12
# Gamma_C is in a plane if it is thinner than this share of its extent.
_PLANE = 1e-6
# At a larger ratio of the largest to the median pressure the colours follow the square root.
_PEAKED = 6.0


def pressure_norm(points: ContactPoints) -> Normalize:
    """The scale of colours for the pressure."""
    # On a linear scale a peak at a corner would leave all other points dark.
    touching = points.pressure[points.pressure > 0.0]
    peaked = len(touching) > 0 and touching.max() > _PEAKED * np.median(touching)
    return PowerNorm(0.5 if peaked else 1.0, vmin=0.0, vmax=touching.max(initial=0.0) or 1.0)


def slipping(points: ContactPoints) -> IntArray:
    """The slipping points that have an arrow: one of several whose arrows would overlap."""
    slips = np.flatnonzero(points.state == SLIP)
    places = points.x[slips] * (_ARROWS / float(np.ptp(points.x, axis=0).max()))
    boxes = np.floor(places)
    # The arrow of a box is at the point that is nearest to the middle of the box.
    order = np.argsort(np.linalg.norm(places - boxes - 0.5, axis=1))
    first = np.unique(boxes[order], axis=0, return_index=True)[1]
    return slips[np.sort(order[first])]


def colour_values(
    axes: Axes, points: ContactPoints, facets: IntArray, values: FloatArray, **look: Any
) -> TriMesh:
    """Draw values at the points in colours that are interpolated between them."""
    i, j = _orient(axes, points)
    flat = points.x[:, i], points.x[:, j]
    colours = axes.tripcolor(*flat, facets, values, shading="gouraud", **look)
    axes.margins(0.0)
    return colours


def colour_states(axes: Axes, points: ContactPoints, facets: IntArray, **look: Any) -> None:
    """Draw the states: a point colours the parts of its facets that are nearest to the point."""
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
    """Divide facets (m, d) of points x (k, e) into one part for each corner: shapes, and corners.

    The shapes are quadrilaterals (d m, 4, e) of triangles or halves (d m, 2, e) of segments.
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
    """The two axes of a map that shows Gamma_C from the foundation, and whether the second is down.

    The viewer looks against the mean normal, along an axis of coordinates.
    """
    normal, extent = points.normal.mean(axis=0), np.ptp(points.x, axis=0)
    across = int(np.argmax(np.abs(normal)))
    # Beside a tool the normals may point along a plane Gamma_C, of which the map shows all.
    if extent.min() < _PLANE * extent.max():
        across = int(np.argmin(extent))
    i, j = (axis for axis in range(3) if axis != across)
    # The cross product of right and up points at the viewer, as the normal does.
    return i, j, bool(np.cross(np.eye(3)[i], np.eye(3)[j]) @ normal < 0.0)


def _orient(axes: Axes, points: ContactPoints) -> list[int]:
    """Label the axes of a map, and return the two axes of coordinates that the map shows."""
    i, j, downwards = frame(points)
    axes.set_xlabel(f"${AXES[i]}$")
    axes.set_ylabel(f"${AXES[j]}$")
    axes.yaxis.set_inverted(downwards)
    return [i, j]
