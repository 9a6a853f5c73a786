"""Rigid motions in words, and where the resultant of the loads meets a flat foundation."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import AXES, FloatArray

# A part of a motion below this share of the rest is left out of the words.
_SHARE = 0.2
# Coordinates and directions below this share of the others are zero.
_ROUNDING = 1e-6


def spin(motion: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The velocity of the origin (3,) and the spin (3,) of a rigid motion.

    ``motion`` are the coefficients of :func:`rigid_motions`:
    translations, then the rotations in the planes of the axes (x, y), (x, z) and (y, z).
    """
    if len(motion) == 1:
        return np.array([0.0, motion[0], 0.0]), np.zeros(3)
    if len(motion) == 3:
        return np.array([*motion[:2], 0.0]), np.array([0.0, 0.0, motion[2]])
    return np.asarray(motion[:3]), np.array([motion[5], -motion[4], motion[3]])


def describe_motion(motion: FloatArray, box: FloatArray) -> str:
    """A rigid motion in words, with the place of its axis for a rotation.

    ``motion`` (3 or 6 coefficients, 1 of an axisymmetric body) is as in :func:`spin`, and ``box``
    (2, d) are the least and greatest coordinates of the body.
    """
    if len(motion) == 1:
        return "translation along y, the axis"
    dim = box.shape[1]
    at_origin, turn = spin(motion)
    middle, size = np.zeros(3), float(np.linalg.norm(np.ptp(box, axis=0)))
    middle[:dim] = box.mean(axis=0)
    moved = at_origin + np.cross(turn, middle)
    rate = float(np.linalg.norm(turn))
    if 0.5 * size * rate < _SHARE * np.linalg.norm(moved):
        return f"translation along {axes_of(moved)}"
    along = moved @ turn / rate**2 * turn
    place = middle + np.cross(turn, moved) / rate**2
    if dim == 2:
        return f"rotation about {point(place[:2], size)}"
    words = f"rotation about the line along {axes_of(turn)} through {point(place, size)}"
    if np.linalg.norm(along) < _SHARE * 0.5 * size * rate:
        return words
    return f"translation along {axes_of(along)} with {words}"


def point(place: Iterable[float], size: float) -> str:
    """A point of a body of some size, to five digits: (40, 0)."""
    shown = [0.0 if abs(x) < _ROUNDING * size else x for x in place]
    return "(" + ", ".join(f"{x:.5g}" for x in shown) + ")"


def axes_of(direction: FloatArray) -> str:
    """The axes along which a direction has a part: x and y."""
    share = np.abs(direction) / np.abs(direction).max()
    return " and ".join(axis for axis, part in zip(AXES, share, strict=False) if part > _SHARE)


@dataclass(frozen=True)
class Resultant:
    """The resultant of loads on a flat foundation.

    At ``place`` (d,) in the plane of the foundation the loads have no moment about axes in the
    plane.  ``pressing`` > 0 is the force onto the foundation, and ``along`` (d,) the force in the
    plane.
    """

    place: FloatArray
    pressing: float
    along: FloatArray


def resultant_on_plane(
    force: FloatArray, moment: FloatArray, points: FloatArray, normals: FloatArray
) -> Resultant | None:
    """The resultant of loads; None if the foundation is not flat, or the loads do not press.

    ``force`` (3,) and ``moment`` (3,) about the origin are those of the loads, ``points`` (k, d)
    and ``normals`` (k, d) the nodes of Gamma_C with the contact normals.
    """
    if not len(points):
        return None
    dim = points.shape[1]
    normal, middle = np.zeros(3), np.zeros(3)
    normal[:dim], middle[:dim] = normals[0], points.mean(axis=0)
    heights = (points - middle[:dim]) @ normals[0]
    is_plane = np.abs(heights).max() <= _ROUNDING * np.ptp(points, axis=0).max()
    if not is_plane or np.abs(normals - normals[0]).max() > _ROUNDING:
        return None
    pressing = float(force @ normal)
    if pressing <= _ROUNDING * np.linalg.norm(force):
        return None
    place = middle + np.cross(normal, moment - np.cross(middle, force)) / pressing
    return Resultant(place[:dim], pressing, (force - pressing * normal)[:dim])
