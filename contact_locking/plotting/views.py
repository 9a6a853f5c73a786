"""What the picture of a body in three dimensions shows, and from where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from contact_locking.plotting import style
from contact_locking.plotting.camera import Camera, across, camera, from_below, from_the_side
from contact_locking.plotting.foundation import foundation
from contact_locking.plotting.snapshot import ContactMap, FloatArray, Snapshot

Image = npt.NDArray[np.uint8]

BODY, LOCKED, CUT, CONTACT = "body", "locked", "cut", "contact"

# In inches.
WIDTH = 3.55
_TALLEST, _FLATTEST = 3.9, 1.2
# Free space around Gamma_C, which shows where in the body it is.
_AROUND = 0.12


@dataclass(frozen=True)
class View:
    """A camera and the size of its picture, in inches."""

    camera: Camera

    @property
    def width(self) -> float:
        return WIDTH

    @property
    def height(self) -> float:
        return WIDTH * self.camera.height / self.camera.width

    def place(self, points: FloatArray) -> FloatArray:
        """Where points (k, 3) are: inches (k, 2) from the lower left corner."""
        return self.camera.place(points) * (self.width, self.height)


def views(body: Snapshot) -> dict[str, View]:
    """The views by name: the body; its locked zone, or a cut where it has none; Gamma_C."""
    factor = style.magnification(body)
    x = style.deformed(body, factor)
    normal = mean_normal(body.contact)
    extent = np.vstack([x, body.x])
    if body.contact is not None:
        ground = foundation(body.contact, factor, body.size)
        extent = np.vstack([extent, ground.reshape(-1, 3)])
    side = _view(extent, from_the_side(normal))
    found = {BODY: side, LOCKED if body.locked.any() else CUT: side}
    if body.contact is not None and normal is not None:
        found[CONTACT] = _view(x[body.contact.vertices], from_below(normal), _AROUND)
    return found


def cut(body: Snapshot, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The plane that opens the body ``x``: its normal towards the viewer, and where it is.

    It goes through the middle of the pressure, or of the body.
    """
    towards = across(mean_normal(body.contact))
    middle = 0.5 * (x.min(axis=0) + x.max(axis=0))
    if body.contact is not None and body.contact.points.pressure.any():
        weights = body.contact.points.pressure
        middle = np.average(x[body.contact.vertices], axis=0, weights=weights)
    return towards, middle


def mean_normal(contact: ContactMap | None) -> FloatArray | None:
    """The outward normal in the mean over Gamma_C; downwards where these cancel."""
    if contact is None:
        return None
    mean: FloatArray = contact.points.normal.mean(axis=0)
    length = float(np.linalg.norm(mean))
    return np.array(mean / length if length > 1e-3 else (0.0, 0.0, -1.0))


def _view(points: FloatArray, towards: FloatArray, around: float = 0.0) -> View:
    """The view of points that is as high as they need within what a page has."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    points = middle + (1.0 + 2.0 * around) * (points - middle)
    natural = camera(points, towards)
    height = np.clip(WIDTH * natural.height / natural.width, _FLATTEST, _TALLEST)
    return View(camera(points, towards, float(WIDTH / height)))
