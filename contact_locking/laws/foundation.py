"""Rigid foundations: where the body touches, as a gap and a contact normal at given points.

A foundation is described by its signed distance ``phi(x)``, positive outside of it.  Linearised,
``phi(x + u) >= 0`` reads ``u . nu <= gap`` with ``gap = phi(x)`` and ``nu = -grad phi(x)``: the
contact condition of the paper with the foundation's own normal, which is exact for a half space
and second order in ``u`` for a curved foundation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from contact_locking.arrays import FloatArray


class Foundation(Protocol):
    """Points are given as an array (d, k)."""

    def gap(self, x: FloatArray) -> FloatArray:
        """Signed distance (k,) from the points to the foundation, negative inside it."""

    def contact_normal(self, x: FloatArray) -> FloatArray:
        """Unit vectors (d, k) from the points towards the foundation."""


def _unit(direction: tuple[float, ...]) -> FloatArray:
    """The unit vector; the square of neither a tiny nor a huge component may leave the numbers."""
    vector = np.asarray(direction, dtype=float)
    vector = vector / np.abs(vector).max()
    return vector / np.linalg.norm(vector)


@dataclass(frozen=True)
class HalfSpace:
    """``phi(x) = (x - point) . normal``; ``normal`` points out of the foundation."""

    point: tuple[float, ...]
    normal: tuple[float, ...]

    def _unit_normal(self) -> FloatArray:
        return _unit(self.normal)

    def gap(self, x: FloatArray) -> FloatArray:
        return self._unit_normal() @ (x - np.asarray(self.point)[:, None])

    def contact_normal(self, x: FloatArray) -> FloatArray:
        return np.repeat(-self._unit_normal()[:, None], x.shape[1], axis=1)


@dataclass(frozen=True)
class Round:
    """``phi(x) = |P (x - centre)| - radius``: a disc or a sphere, or a cylinder along ``axis``.

    ``P`` removes the component along ``axis``, where there is one.
    """

    centre: tuple[float, ...]
    radius: float
    axis: tuple[float, ...] | None = None

    def _radial(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        radial = x - np.asarray(self.centre, dtype=float)[:, None]
        if self.axis is not None:
            axis = _unit(self.axis)
            radial = radial - np.outer(axis, axis @ radial)
        return radial, np.linalg.norm(radial, axis=0)

    def gap(self, x: FloatArray) -> FloatArray:
        return self._radial(x)[1] - self.radius

    def contact_normal(self, x: FloatArray) -> FloatArray:
        radial, distance = self._radial(x)
        # At the centre itself no direction is nearest; the point is far inside, any will do.
        return -radial / np.maximum(distance, np.finfo(float).tiny)
