"""How a picture looks at a body: parallel projections, the same for VTK and for Matplotlib."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contact_locking.plotting.snapshot import FloatArray

# From where one looks at a body: in front, from the right, a little from above.
_ELEVATION, _AZIMUTH = 20.0, -58.0
# An axis is across the foundation if its share in the normal is at least this.
_ALONG = 0.9
# How far the view of Gamma_C is from the side, as a share of how far it is from below.
_ASLANT = 0.55
# Free space around what is drawn, as a share of it, and more to the left for arrows along the axes.
_MARGIN, _GUTTER = 0.02, 0.1


@dataclass(frozen=True)
class Camera:
    """A parallel projection onto a picture ``width`` by ``height`` wide, in units of length.

    ``towards``, ``right`` and ``up`` (3,) are orthonormal, ``towards`` points at the viewer.
    """

    towards: FloatArray
    right: FloatArray
    up: FloatArray
    centre: FloatArray
    width: float
    height: float

    def place(self, points: FloatArray) -> FloatArray:
        """Where points (k, 3) are in the picture (k, 2): from 0 at the lower left to 1."""
        away = points - self.centre
        share = np.column_stack([away @ self.right / self.width, away @ self.up / self.height])
        return share + 0.5


def camera(points: FloatArray, towards: FloatArray, aspect: float | None = None) -> Camera:
    """The camera that has all points (k, 3) in its picture, and z upwards in it.

    ``aspect`` is width over height, by default that of what is seen.
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


def from_the_side(normal: FloatArray | None) -> FloatArray:
    """Towards a viewer who has the foundation, in the direction of ``normal``, behind the body."""
    up, around = np.radians([_ELEVATION, _AZIMUTH])
    towards = np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    if normal is not None:
        towards -= 2.0 * max(float(towards @ normal), 0.0) * normal
    return towards


def across(normal: FloatArray | None) -> FloatArray:
    """Of the axes along the foundation the one that points most at the viewer from the side."""
    side = from_the_side(normal)
    free = np.ones(3) if normal is None else np.abs(normal) < _ALONG
    axis = int(np.argmax(np.abs(side) * free))
    return np.sign(side[axis]) * np.eye(3)[axis]


def from_below(normal: FloatArray) -> FloatArray:
    """Towards a viewer who looks at Gamma_C, whose mean outward normal is given, aslant."""
    side = across(normal)
    side = side - (side @ normal) * normal
    return normal + _ASLANT * side
