"""The surfaces of foundations that pictures draw, within a box around the body."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError
from contact_locking.shapes.distance import Distance

# The box reaches beyond the body by this share of the longest edge of the body's own box.
_BESIDE = 0.25
# The points of the grid for zero lines along each axis; the rings of a ball, and the points of each
# ring.
_GRID, _RINGS, _AROUND = 201, 24, 48


def box_around(bounding_box: FloatArray, axisymmetric: bool) -> FloatArray:
    """The box (2, d) within which foundations are drawn; that of (r, z) ends at the axis."""
    margin = _BESIDE * float(np.ptp(bounding_box, axis=0).max())
    low, high = bounding_box[0] - margin, bounding_box[1] + margin
    if axisymmetric:
        low[0] = max(low[0], 0.0)
    return np.stack([low, high])


def zero_line(body: Distance, box: FloatArray) -> FloatArray:
    """The segments (m, 2, 2) of ``phi = 0`` in a box (2, 2), with the foundation on their left."""
    # Its import would take long where nothing is drawn.
    import contourpy

    x, y = (np.linspace(low, high, _GRID) for low, high in box.T)
    points = np.stack(np.meshgrid(x, y)).reshape(2, -1)
    try:
        with np.errstate(all="ignore"):
            distance = body.gap(points)
    except InputError:
        # An expression needs values on Gamma_C only.
        return np.empty((0, 2, 2))
    values = np.ma.masked_invalid(distance.reshape(_GRID, _GRID))
    lines = contourpy.contour_generator(x, y, values).lines(0.0)
    return np.concatenate([np.empty((0, 2, 2)), *(_segments(np.asarray(line)) for line in lines)])


def _segments(line: FloatArray) -> FloatArray:
    """The segments (m, 2, 2) along the reverse of a line (k, 2), without those of no length."""
    # The lines of contourpy have the larger values on their left.
    found = np.stack([line[:0:-1], line[-2::-1]], axis=1)
    return np.asarray(found[np.any(found[:, 0] != found[:, 1], axis=1)])


def ball(centre: FloatArray, radius: float, box: FloatArray) -> FloatArray:
    """A ball, or of a ball that is wider than the box the cap that is nearest to its middle."""
    away = box.mean(axis=0) - centre
    distance = float(np.linalg.norm(away))
    pole = away / distance if distance > 0.0 else np.eye(3)[2]
    width = 0.5 * float(np.ptp(box, axis=0).max())
    widest = np.pi if radius <= width else float(np.arcsin(width / radius))
    # The axis that is farthest from the pole gives a direction across.
    first = np.cross(pole, np.eye(3)[np.argmin(np.abs(pole))])
    first /= np.linalg.norm(first)
    second = np.cross(pole, first)
    polar = np.linspace(0.0, widest, _RINGS + 1)[:, None]
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND + 1)
    across = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    outwards = np.cos(polar)[..., None] * pole + np.sin(polar)[..., None] * across
    points = centre + radius * outwards
    here, along, up, both = points[:-1, :-1], points[:-1, 1:], points[1:, :-1], points[1:, 1:]
    lower = np.stack([here, up, both], axis=2).reshape(-1, 3, 3)
    upper = np.stack([here, both, along], axis=2).reshape(-1, 3, 3)
    # At a pole one of both triangles is a point.
    end = len(lower) - (_AROUND if widest == np.pi else 0)
    return np.concatenate([lower[:end], upper[_AROUND:]])
