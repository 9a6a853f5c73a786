"""Rigid motions of foundations: ``X -> x = about + R (X - about) + translation``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray


@dataclass(frozen=True)
class RigidMotion:
    """``x = about + R (X - about) + translation`` for the points X of a foundation at rest.

    ``translation`` and ``about`` are (d,), and ``turn`` (d, d) is the rotation R.  The point
    ``about`` moves by the translation alone.
    """

    translation: FloatArray
    turn: FloatArray
    about: FloatArray

    @classmethod
    def rest(cls, dim: int) -> RigidMotion:
        """The motion that moves nothing."""
        return cls(np.zeros(dim), np.eye(dim), np.zeros(dim))

    def place(self, points: FloatArray) -> FloatArray:
        """The present places of the points X (d, k) of the foundation at rest."""
        about = self.about[:, None]
        return about + self.turn @ (points - about) + self.translation[:, None]

    def origin(self, places: FloatArray) -> FloatArray:
        """The points X (d, k) of the foundation at rest that are now at ``places`` (d, k)."""
        about = self.about[:, None]
        return about + self.turn.T @ (places - about - self.translation[:, None])

    def step_from(self, before: RigidMotion, places: FloatArray) -> FloatArray:
        """The way (d, k) of the points of the foundation at ``places`` since ``before``."""
        return self.place(before.origin(places)) - places


def skew(axis: FloatArray) -> FloatArray:
    """The skew matrix of ``x -> axis x x``, for an axis (1,) across the plane or (3,) in space."""
    if len(axis) == 1:
        return np.array([[0.0, -axis[0]], [axis[0], 0.0]])
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation(angles: FloatArray) -> FloatArray:
    """The rotation R by an angle (1,) in the plane, or by a rotation vector (3,), in radians.

    In space ``R = exp([w])`` by Rodrigues' formula, a turn by the angle ``|w|`` about w.
    """
    if len(angles) == 1:
        cosine, sine = np.cos(angles[0]), np.sin(angles[0])
        return np.array([[cosine, -sine], [sine, cosine]])
    angle = float(np.linalg.norm(angles))
    cross = skew(angles)
    # sin(a)/a and (1 - cos(a))/a^2, which have limits at a = 0.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)
