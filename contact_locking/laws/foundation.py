"""Rigid foundations: the gap and the contact normal at given points.

A foundation is described by its signed distance ``phi(x)``, which is positive outside.  Linearised,
``phi(x + u) >= 0`` reads ``u . nu <= gap`` with ``gap = phi(x)`` and ``nu = -grad phi(x)``.  This
is the contact condition (5) with the normal of the foundation.  The linearisation is exact for a
half space; for a curved foundation its error is of second order in ``u``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError


class Foundation(Protocol):
    """The shape of a foundation; its methods take points as an array (d, k)."""

    def gap(self, x: FloatArray) -> FloatArray:
        """``phi(x)`` (k,): the signed distance, negative inside the foundation."""

    def contact_normal(self, x: FloatArray) -> FloatArray:
        """``-grad phi(x)`` (d, k): unit vectors that point into the foundation."""


def _unit(direction: tuple[float, ...]) -> FloatArray:
    vector = np.asarray(direction, dtype=float)
    # Scaled first, so that the squares of tiny and huge components neither underflow nor overflow.
    vector = vector / np.abs(vector).max()
    return vector / np.linalg.norm(vector)


@dataclass(frozen=True)
class HalfSpace:
    """``phi(x) = (x - point) . normal``; ``normal`` points out of the foundation."""

    point: tuple[float, ...]
    normal: tuple[float, ...]

    def gap(self, x: FloatArray) -> FloatArray:
        return _unit(self.normal) @ (x - np.asarray(self.point)[:, None])

    def contact_normal(self, x: FloatArray) -> FloatArray:
        return np.repeat(-_unit(self.normal)[:, None], x.shape[1], axis=1)


@dataclass(frozen=True)
class Round:
    """``phi(x) = |P (x - centre)| - radius``: a disc or a sphere, or a cylinder along ``axis``.

    ``P`` removes the component along ``axis``; without an axis ``P`` is the identity.
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
        # No direction is the nearest at the centre itself: the normal there is the zero vector.
        return -radial / np.maximum(distance, np.finfo(float).tiny)


class Sphere(Round):
    """``phi(x) = |x - centre| - radius``; a disc in 2D."""

    def __init__(self, centre: tuple[float, ...], radius: float) -> None:
        super().__init__(centre, radius)


class Cylinder(Round):
    """The points of 3D whose distance to a line through ``centre`` along ``axis`` is a radius."""

    def __init__(
        self,
        centre: tuple[float, ...],
        radius: float,
        axis: tuple[float, ...] = (0.0, 1.0, 0.0),
    ) -> None:
        super().__init__(centre, radius, axis)


@dataclass(frozen=True)
class LevelSet:
    """``phi(x) = f(x)/|grad f(x)|``: to first order the distance to the surface ``f = 0``.

    ``function`` maps points (d, k) to f (k,) and its gradient (d, k); f is positive outside.  Where
    f is a distance, ``|grad f| = 1``, this is exact.  Where the gradient vanishes, phi is not
    finite.
    """

    function: Callable[[FloatArray], tuple[FloatArray, FloatArray]]

    def _evaluated(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        found = self.function(x)
        if not isinstance(found, tuple | list) or np.shape(found[-1]) != x.shape:
            raise InputError("the function of a LevelSet returns f (k,) and its gradient (d, k)")
        return found[0], found[1]

    def slope(self, x: FloatArray) -> FloatArray:
        """``|grad f|`` (k,) at points (d, k)."""
        return np.asarray(np.linalg.norm(self._evaluated(x)[1], axis=0))

    def gap(self, x: FloatArray) -> FloatArray:
        values, gradient = self._evaluated(x)
        return np.asarray(values / np.linalg.norm(gradient, axis=0))

    def contact_normal(self, x: FloatArray) -> FloatArray:
        gradient = self._evaluated(x)[1]
        return np.asarray(-gradient / np.linalg.norm(gradient, axis=0))
