"""The views in the picture of a body in three dimensions, each with its camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from contact_locking.arrays import FloatArray
from contact_locking.extras.pictures import style
from contact_locking.extras.pictures.snapshot import ContactMap, Snapshot, foundation, tool

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


Image = npt.NDArray[np.uint8]

BODY, LOCKED, CUT, CONTACT = "body", "locked", "cut", "contact"

# The width of a view in inches, and the limits of its height as shares of the width.
WIDTH = 3.55
_TALLEST, _FLATTEST = 1.1, 0.34
# Free space around Gamma_C, which shows the body around it, as a share of its extent.
_AROUND = 0.12


@dataclass(frozen=True)
class View:
    """A camera and the size of its picture, in inches."""

    camera: Camera
    width: float = WIDTH

    @property
    def height(self) -> float:
        return self.width * self.camera.height / self.camera.width

    def place(self, points: FloatArray) -> FloatArray:
        """The places (k, 2) of points (k, 3), in inches from the lower left corner."""
        return self.camera.place(points) * (self.width, self.height)


def views(body: Snapshot) -> dict[str, View]:
    """The views by name: the body; its locked zone, or a cut if it has none; each contact."""
    factor = style.magnification(body)
    x = style.deformed(body, factor)
    side = side_view([body], factor)
    found = {BODY: side, LOCKED if body.locked.any() else CUT: side}
    for number, part in enumerate(body.contact.parts()):
        below = from_below(mean_normal(part))
        found[contact_view(number)] = _view(x[part.vertices], below, _AROUND)
    return found


def side_view(bodies: Sequence[Snapshot], factor: float, width: float = WIDTH) -> View:
    """The view of a body, or of a film with bodies on one mesh, and of their foundations."""
    first = bodies[0]
    points = [first.x]
    for body in bodies:
        points.append(style.deformed(body, factor))
        for part in body.contact.parts():
            points.append(foundation(part, factor, body.size).reshape(-1, 3))
    # A tool that is drawn as a whole hides the body less than the ground does.
    seen = any(len(tool(part, factor)) for part in first.contact.parts())
    behind = np.zeros(3) if seen else mean_normal(first.contact)
    return _view(np.vstack(points), from_the_side(behind), width=width)


def contact_view(number: int) -> str:
    """The name of the view of one contact."""
    return f"{CONTACT}.{number}" if number else CONTACT


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


def _view(
    points: FloatArray, towards: FloatArray, around: float = 0.0, width: float = WIDTH
) -> View:
    """The view of points, as high as they need within the limits of a page."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    points = middle + (1.0 + 2.0 * around) * (points - middle)
    natural = camera(points, towards)
    height = np.clip(natural.height / natural.width, _FLATTEST, _TALLEST)
    return View(camera(points, towards, float(1.0 / height)), width)
