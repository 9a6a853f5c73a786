"""Shapes that are given by formulae: half spaces, balls, cylinders, zeros of a function."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError
from contact_locking.shapes.shape import Distance, Shape
from contact_locking.values.concept import ONLY, BodyKind, Components, Fault, entry
from contact_locking.values.kinds import Direction, Point, Positive, TimedScalar
from contact_locking.values.value import Value


def _unit(direction: tuple[float, ...]) -> FloatArray:
    vector = np.asarray(direction, dtype=float)
    # Scaled first, so that the squares of tiny and huge components neither underflow nor overflow.
    vector = vector / np.abs(vector).max()
    return vector / np.linalg.norm(vector)


class HalfSpace(Shape):
    """``phi(x) = (x - point) . n`` with the unit vector n along ``normal``."""

    key = "half_space"
    text = "a half space"
    is_plane = True
    turn_normal = ", or turn the normal of the half space towards the body"

    point: Point = entry(..., "a point of its surface", "length")
    normal: Direction = entry(..., "normal of its surface, towards the body; of any length", "1")

    def gap(self, x: FloatArray) -> FloatArray:
        return _unit(self.normal) @ (x - np.asarray(self.point)[:, None])

    def contact_normal(self, x: FloatArray) -> FloatArray:
        return np.repeat(-_unit(self.normal)[:, None], x.shape[1], axis=1)


class Sphere(Shape):
    """``phi(x) = |x - centre| - radius``; a disc in 2D."""

    key = "sphere"
    text = "a sphere, in 2D a disc"

    centre: Point = entry(..., "its centre", "length")
    radius: Positive = entry(..., "its radius", "length")

    def _radial(self, x: FloatArray) -> FloatArray:
        return x - np.asarray(self.centre, dtype=float)[:, None]

    def gap(self, x: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.norm(self._radial(x), axis=0) - self.radius)

    def contact_normal(self, x: FloatArray) -> FloatArray:
        radial = self._radial(x)
        # No direction is the nearest at the centre itself: the normal there is the zero vector.
        return -radial / np.maximum(np.linalg.norm(radial, axis=0), np.finfo(float).tiny)


class Cylinder(Sphere):
    """The distance to the line through ``centre`` along ``axis``, less ``radius``; a disc in 2D."""

    key = "cylinder"
    text = "a cylinder, in 2D a disc"

    axis: Annotated[Direction, Components(3)] | None = entry(
        None, "its direction, in 3D only; null: [0, 1, 0]", "1"
    )

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if body.dim == 2 and self.axis is not None:
            yield Fault(("axis",), "must be left out in 2D")
        if body.axisymmetric:
            message = "is not a body of revolution about x = 0; use sphere or half_space"
            yield Fault((), message)

    def _radial(self, x: FloatArray) -> FloatArray:
        radial = super()._radial(x)
        if len(x) == 2:
            return radial
        axis = _unit(self.axis or (0.0, 1.0, 0.0))
        return radial - np.outer(axis, axis @ radial)


class LevelSet(Shape):
    """``phi(x) = f(x)/|grad f(x)|``: to first order the distance to the surface ``f = 0``.

    ``function`` is f, positive outside: an expression of x, y, z and t, or a function that maps
    points (d, k) to f (k,) and its gradient (d, k).  Where f is a distance, ``|grad f| = 1``, this
    is exact.  Where the gradient vanishes, phi is not finite.
    """

    key = "expression"
    text = "signed distance as an expression of position and t, positive outside"
    unit = "length"
    is_distance = False
    turn = "change the sign of expression, which is positive outside of the foundation"

    function: TimedScalar = entry(..., "f", "length", alias=ONLY)

    @property
    def is_timed(self) -> bool:
        return self.function.expression is not None and self.function.is_timed

    def at(self, time: float) -> Distance:
        return LevelSetAt(self.function, time)

    def gap(self, x: FloatArray) -> FloatArray:
        return self.at(0.0).gap(x)

    def contact_normal(self, x: FloatArray) -> FloatArray:
        return self.at(0.0).contact_normal(x)


class LevelSetAt:
    """A `LevelSet` at a time."""

    def __init__(self, function: Value, time: float) -> None:
        self._function, self._time = function, time

    def _evaluated(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        if self._function.expression is not None:
            return self._function.with_gradient(x, self._time)
        values = self._function.data(x)
        if not isinstance(values, tuple | list) or np.shape(values[-1]) != x.shape:
            raise InputError("the function of a LevelSet returns f (k,) and its gradient (d, k)")
        return values[0], values[1]

    def slope(self, x: FloatArray) -> FloatArray:
        """``|grad f|`` (k,) at points (d, k)."""
        return np.asarray(np.linalg.norm(self._evaluated(x)[1], axis=0))

    def gap(self, x: FloatArray) -> FloatArray:
        values, gradient = self._evaluated(x)
        return np.asarray(values / np.linalg.norm(gradient, axis=0))

    def contact_normal(self, x: FloatArray) -> FloatArray:
        gradient = self._evaluated(x)[1]
        return np.asarray(-gradient / np.linalg.norm(gradient, axis=0))
