"""The cameras of the views of a body in three dimensions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.view.pictures import style
from contact_locking.view.pictures.snapshot import ContactMap, Snapshot, foundation, tool

# The direction to the viewer, in degrees: in front, from the right, a little from above.
_ELEVATION, _AZIMUTH = 20.0, -58.0
# An axis crosses the foundation if its share in the normal is at least this.
_ALONG = 0.9
# The view of Gamma_C from below is turned to the side by this share.
_ASLANT = 0.55
# Free space around Gamma_C, which shows the body around it, as a share of its extent.
_AROUND = 0.12


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


def camera(points: FloatArray, towards: FloatArray) -> Camera:
    """The camera whose picture shows all points (k, 3), with z upwards."""
    towards = towards / np.linalg.norm(towards)
    upright = np.eye(3)[2 if abs(towards[2]) < 0.999 else 1]
    right = np.array(np.cross(upright, towards), dtype=np.float64)
    right /= np.linalg.norm(right)
    up = np.array(np.cross(towards, right), dtype=np.float64)
    frame = np.array([right, up, towards])
    seen = points @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    smallest = 1e-9 + 1e-3 * float((high - low).max())
    width, height, _ = np.maximum(high - low, smallest)
    centre: FloatArray = 0.5 * (low + high) @ frame
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


def side_camera(body: Snapshot, factor: float) -> Camera:
    """The camera of a body and of its foundations."""
    parts = body.contact.parts()
    grounds = [foundation(part, factor, body.size).reshape(-1, 3) for part in parts]
    points = [body.x, style.deformed(body, factor), *grounds]
    # A tool that is drawn as a whole hides the body less than the ground does.
    seen = any(len(tool(part, factor)) for part in parts)
    behind = np.zeros(3) if seen else mean_normal(body.contact)
    return camera(np.vstack(points), from_the_side(behind))


def contact_camera(body: Snapshot, contact: ContactMap, factor: float) -> Camera:
    """The camera of one contact of a body, which sees Gamma_C and a little of what is around."""
    points = style.deformed(body, factor)[contact.vertices]
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    around = middle + (1.0 + 2.0 * _AROUND) * (points - middle)
    return camera(around, from_below(mean_normal(contact)))


def cut(body: Snapshot, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The plane that opens the body ``x``: its normal towards the viewer, and a point of it.

    The plane goes through the middle of the pressure, or of a body without pressure.
    """
    towards = across(mean_normal(body.contact))
    middle = 0.5 * (x.min(axis=0) + x.max(axis=0))
    weights = body.contact.points.pressure
    if weights.any():
        middle = np.average(x[body.contact.vertices], axis=0, weights=weights)
    return towards, middle


def mean_normal(contact: ContactMap) -> FloatArray:
    """The mean outward normal of Gamma_C; downwards if normals cancel or there are none."""
    mean: FloatArray = contact.points.normal.sum(axis=0) / max(len(contact.points), 1)
    length = float(np.linalg.norm(mean))
    return np.array(mean / length if length > 1e-3 else (0.0, 0.0, -1.0))
