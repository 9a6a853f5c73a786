"""Parallel projections of a body, the same for VTK and for Matplotlib."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray

# The direction to the viewer, in degrees: in front, from the right, a little from above.
_ELEVATION, _AZIMUTH = 20.0, -58.0
# An axis crosses the foundation if its share in the normal is at least this.
_ALONG = 0.9
# The view of Gamma_C from below is turned to the side by this share.
_ASLANT = 0.55
# Free space around the points, as shares of their extent; the gutter at the left is for arrows.
_MARGIN, _GUTTER = 0.02, 0.1


@dataclass(frozen=True)
class Camera:
    """A parallel projection onto a picture of ``width`` by ``height``, in units of length.

    ``towards``, ``right`` and ``up`` (3,) are orthonormal, ``towards`` points at the viewer.
    """

    towards: FloatArray
    right: FloatArray
    up: FloatArray
    centre: FloatArray
    width: float
    height: float

    def place(self, points: FloatArray) -> FloatArray:
        """The places (k, 2) of points (k, 3) in the picture: from 0 at the lower left to 1."""
        away = points - self.centre
        share = np.column_stack([away @ self.right / self.width, away @ self.up / self.height])
        return share + 0.5


def camera(points: FloatArray, towards: FloatArray, aspect: float | None = None) -> Camera:
    """The camera whose picture shows all points (k, 3), with z upwards.

    ``aspect`` is width over height, by default that of the points in the picture.
    """
    towards = towards / np.linalg.norm(towards)
    upright = np.eye(3)[2 if abs(towards[2]) < 0.999 else 1]
    right = np.array(np.cross(upright, towards), dtype=np.float64)
    right /= np.linalg.norm(right)
    up = np.array(np.cross(towards, right), dtype=np.float64)
    frame = np.array([right, up, towards])
    seen = points @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    smallest = 1e-9 + 1e-3 * float((high - low).max())
    middle, size = 0.5 * (low + high), np.maximum(high - low, smallest)
    middle[0] -= 0.5 * _GUTTER * size[0]
    centre: FloatArray = middle @ frame
    width, height = size[:2] * (1.0 + 2.0 * _MARGIN + np.array([_GUTTER, 0.0]))
    if aspect is not None:
        width, height = max(width, aspect * height), max(height, width / aspect)
    return Camera(towards, right, up, centre, float(width), float(height))


def from_the_side(normal: FloatArray) -> FloatArray:
    """The direction to a viewer for whom the foundation, on the side of ``normal``, is behind."""
    up, around = np.radians([_ELEVATION, _AZIMUTH])
    towards = np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    return towards - 2.0 * max(float(towards @ normal), 0.0) * normal


def across(normal: FloatArray) -> FloatArray:
    """The axis along the foundation that points most at the viewer from the side."""
    side = from_the_side(normal)
    free = np.abs(normal) < _ALONG
    axis = int(np.argmax(np.abs(side) * free))
    return np.sign(side[axis]) * np.eye(3)[axis]


def from_below(normal: FloatArray) -> FloatArray:
    """The direction to a viewer who looks aslant at Gamma_C; ``normal`` is the mean outward one."""
    side = across(normal)
    side = side - (side @ normal) * normal
    return normal + _ASLANT * side
