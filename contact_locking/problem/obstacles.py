"""What stops the body at a contact: a given gap, or a rigid foundation that may move."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import AXES, FloatArray
from contact_locking.errors import InputError, with_key
from contact_locking.expressions import TIME, parse
from contact_locking.laws.foundation import Foundation, HalfSpace, Round
from contact_locking.laws.rigid_motion import MovedFoundation, RigidMotion, rotation
from contact_locking.parallel import on_any_rank, on_every_rank
from contact_locking.parameters import ContactParameters, rigid_body
from contact_locking.problem.clock import Clock, is_timed
from contact_locking.problem.coefficients import evaluate
from contact_locking.problem.surface import ContactSurface


class Obstacle(Protocol):
    """What the body at one contact does not enter; it may depend on the time of a clock.

    ``is_timed`` says that gap or normal change with the time, and ``moves`` that the obstacle has a
    motion, which drags the body by friction.
    """

    is_timed: bool
    moves: bool

    def gap(self, x: FloatArray) -> FloatArray:
        """The gap (k,) at points (d, k) of Gamma_C at the present time; collective."""

    def at_nodes(self, surface: ContactSurface) -> tuple[FloatArray, FloatArray]:
        """The gap (k,) and the contact normal (k, d) at the nodes at present; collective."""

    def drag(self, surface: ContactSurface, since: float | None) -> FloatArray:
        """How far (k, d) the obstacle has moved at the nodes since a time, or since it was at rest.

        ``since`` is None for the state at rest.
        """


class GivenGap:
    """A gap along the outward normal of the body, as a number or an expression."""

    moves = False

    def __init__(self, comm: MPI.Intracomm, given: ContactParameters, clock: Clock) -> None:
        self._comm, self._gap, self._clock = comm, given.gap, clock
        self._key = f"{given.key}.gap"
        self.is_timed = is_timed(parse(given.gap, (*AXES, TIME), tables=clock.tables))

    def gap(self, x: FloatArray) -> FloatArray:
        clock = self._clock
        return evaluate(self._comm, self._gap, x, self._key, time=clock.now, tables=clock.tables)

    def at_nodes(self, surface: ContactSurface) -> tuple[FloatArray, FloatArray]:
        return self.gap(surface.points.T), surface.body_normals()

    def drag(self, surface: ContactSurface, since: float | None) -> FloatArray:
        return np.zeros_like(surface.points)


class Tool:
    """A rigid body with a prescribed motion from rest, or at rest.

    Raises InputError for a body whose distance is not finite, and one that lies behind Gamma_C.
    """

    def __init__(
        self,
        body: Foundation,
        comm: MPI.Intracomm,
        dim: int,
        given: ContactParameters,
        clock: Clock,
    ) -> None:
        assert given.foundation is not None
        self._body, self._comm, self._dim, self._clock = body, comm, dim, clock
        self._on, self._key = f"{given.key}.on", f"{given.key}.foundation"
        self._motion = given.foundation.moved
        self.moves = self._motion is not None
        self.is_timed = self.moves

    def gap(self, x: FloatArray) -> FloatArray:
        return self.now.gap(x)

    @property
    def now(self) -> Foundation:
        """The body at its present place."""
        return (
            MovedFoundation(self._body, self.motion(self._clock.now)) if self.moves else self._body
        )

    def motion(self, time: float | None) -> RigidMotion:
        """The motion from rest at a time; None for the state at rest."""
        given = self._motion
        if given is None or time is None:
            return RigidMotion.rest(self._dim)
        key = f"{self._key}.motion"
        zero = (0.0,) * self._dim
        angles = given.angles or (0.0,) * (1 if self._dim == 2 else 3)
        return RigidMotion(
            self._at_time(given.translation or zero, time, f"{key}.translation"),
            rotation(self._at_time(angles, time, f"{key}.rotation")),
            np.array(given.about or zero, dtype=float),
        )

    def _at_time(self, components: tuple[float | str, ...], time: float, key: str) -> FloatArray:
        def value(component: float | str) -> float:
            expression = parse(component, (TIME,), tables=self._clock.tables)
            return float(expression.numpy(**{TIME: time}))

        return np.array([with_key(key, partial(value, component)) for component in components])

    def drag(self, surface: ContactSurface, since: float | None) -> FloatArray:
        now = self.motion(self._clock.now)
        return now.step_from(self.motion(since), surface.points.T).T

    def at_nodes(self, surface: ContactSurface) -> tuple[FloatArray, FloatArray]:
        body, points = self.now, surface.points.T
        with np.errstate(all="ignore"):
            gap, normals = body.gap(points), body.contact_normal(points).T
        if not on_every_rank(self._comm, np.isfinite(gap) & np.isfinite(normals).all(axis=1)):
            raise InputError(
                "its distance is not a finite number: the foundation is too far away or too large",
                self._key,
            )
        facing = np.sum(normals * surface.body_normals(), axis=1)
        if on_any_rank(self._comm, facing <= 0.0):
            raise InputError(
                "the foundation lies behind a part of Gamma_C, where the outward normal of the "
                "body points away from the foundation; turn the normal of the half space towards "
                f"the body, or remove from {self._on} the boundary parts that do not face the "
                "foundation",
                self._key,
            )
        return gap, normals


def obstacle_of(comm: MPI.Intracomm, dim: int, given: ContactParameters, clock: Clock) -> Obstacle:
    """The obstacle of a contact; collective."""
    if given.foundation is None:
        return GivenGap(comm, given, clock)
    shape, section = given.foundation.shape
    return Tool(FOUNDATIONS[shape](section, dim), comm, dim, given, clock)


def _half_space(given: rigid_body.HalfSpace, dim: int) -> Foundation:
    return HalfSpace(given.point, given.normal)


def _sphere(given: rigid_body.Sphere, dim: int) -> Foundation:
    return Round(given.centre, given.radius)


def _cylinder(given: rigid_body.Cylinder, dim: int) -> Foundation:
    return Round(given.centre, given.radius, None if dim == 2 else given.axis or (0.0, 1.0, 0.0))


#: For each shape of a section ``foundation``: the foundation of that section in 2 or 3 dimensions.
FOUNDATIONS: dict[str, Callable[[Any, int], Foundation]] = {
    "half_space": _half_space,
    "sphere": _sphere,
    "cylinder": _cylinder,
}
