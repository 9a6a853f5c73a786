"""Rigid motions in words."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from contact_locking.arrays import AXES, FloatArray

# A part of a motion below this share of the rest is left out of the words.
_SHARE = 0.2
# Coordinates below this share of the size of the body are zero.
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
