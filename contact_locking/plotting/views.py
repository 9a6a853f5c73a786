"""The views in the picture of a body in three dimensions, each with its camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from contact_locking.arrays import FloatArray
from contact_locking.plotting import style
from contact_locking.plotting.camera import Camera, across, camera, from_below, from_the_side
from contact_locking.plotting.ground import foundation, tool
from contact_locking.plotting.snapshot import ContactMap, Snapshot

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
