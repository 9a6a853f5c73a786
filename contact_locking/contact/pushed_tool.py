"""Tools: rigid foundations that a prescribed force pushes against the body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.contact.contact import Contact
from contact_locking.errors import InputError, with_key
from contact_locking.expressions import TIME, Expression, parse
from contact_locking.fields.clock import Clock
from contact_locking.parallel import maximum, minimum, on_any_rank
from contact_locking.parameters import Foundation, Parameters

# A force below this share of the largest force is zero with rounding, as in sin(pi*t) at t = 1.
_ROUNDING = 1e-12
# The share of the largest force by which the force may leave its line.
_STRAIGHT = 1e-9
# A tool pushes towards a node if its direction has at least this share along the contact normal.
_FACING = 1e-9


class PushedTool:
    """The foundation of a contact that the force ``F(t) d`` pushes, with its travel q along d.

    The tool is a rigid body.  Its displacement is ``q d`` with the unit vector d, and contact and
    friction limit ``u - q d`` in the place of u: ``(u - q d)_nu <= gap``.  The travel q is unknown.
    In equilibrium the tractions on the body have the resultant F along d,

        int (sigma_nu nu + sigma_tau) . d = F >= 0.

    Across d, and in its rotations, the tool follows its given motion, or stands still.  ``force``
    is F at present, and ``largest`` is the largest F of the process.
    """

    def __init__(
        self, contact: Contact, given: Foundation, clock: Clock, times: Sequence[float]
    ) -> None:
        self.contact, self.key = contact, f"{contact.key}.foundation.force"
        translation = () if given.moved is None else given.moved.translation or ()
        self._force = [_of_time(value, clock) for value in given.force or ()]
        self._translation = [_of_time(value, clock) for value in translation]
        self._travel = 0.0
        contact.is_pushed = True
        forces = np.array([self._vector(self._force, time) for time in times])
        sizes = np.linalg.norm(forces, axis=1)
        self.largest = float(sizes.max())
        if self.largest == 0.0:
            raise InputError(
                "is zero at all times, so that nothing pushes the foundation; leave it out for a "
                "foundation that stands still",
                self.key,
            )
        first = int(np.argmax(sizes > _ROUNDING * self.largest))
        self.direction: FloatArray = forces[first] / sizes[first]
        for time in times:
            self._size(time)
        self._require_facing()
        self.force = 0.0

    def advance(self, time: float) -> None:
        """Take the force of a time.  Raises InputError for a force that leaves its direction."""
        self.force = self._size(time)

    @property
    def pushes(self) -> bool:
        """Whether the force is above zero at present."""
        return self.force > 0.0

    @property
    def travel(self) -> float:
        """q; to set the travel moves the foundation and is collective."""
        return self._travel

    @travel.setter
    def travel(self, value: float) -> None:
        self._travel = float(value)
        self.contact.move_foundation(self._travel * self.direction)

    def touch(self, u: fem.Function, distance: float = 0.0) -> None:
        """Travel until the tool touches the body with the displacement u; collective.

        This is where a force leaves the tool that falls to zero.  The tool keeps a ``distance``
        along its direction.
        """
        contact = self.contact
        towards = contact.free & (self.facing < -_FACING)
        self.travel = 0.0
        room = contact.gaps - contact.split(u)[0]
        comm = contact.surface.domain.comm
        nearest = minimum(comm, room[towards] / -self.facing[towards])
        # Rounding must not leave a pressure.
        size = maximum(comm, np.abs(u.x.array)) + maximum(comm, np.abs(contact.gaps))
        self.travel = nearest - _ROUNDING * size - distance

    @property
    def facing(self) -> FloatArray:
        """``d . nu`` (k,) at the nodes, below zero where the tool comes nearer to the body."""
        return np.asarray(self.contact.normals @ self.direction)

    def resultant(self, pressure: FloatArray, traction: FloatArray) -> float:
        """``int (sigma_tau - p nu) . d`` of nodal p (k,) and ``sigma_tau`` (k, d); collective.

        There is no pressure at held nodes.
        """
        contact = self.contact
        along = traction @ self.direction - contact.free * pressure * self.facing
        return float(contact.surface.integral(along))

    def summary(self) -> dict[str, Any]:
        """The force F, the unit vector d and the travel q, for summary.json."""
        direction = [float(x) + 0.0 for x in self.direction]
        return {"force": self.force, "direction": direction, "travel": self.travel + 0.0}

    def _vector(self, components: Sequence[Expression], time: float) -> FloatArray:
        values = with_key(self.key, lambda: [float(law.numpy(t=time)) for law in components])
        if not np.all(np.isfinite(values)):
            raise InputError(f"is not finite at t = {time:g}", self.key)
        return np.array(values)

    def _size(self, time: float) -> float:
        """F at a time."""
        force = self._vector(self._force, time)
        size = float(force @ self.direction)
        at = f" at t = {time:g}" if any(law.names for law in self._force) else ""
        if np.linalg.norm(force - size * self.direction) > _STRAIGHT * self.largest:
            raise InputError(
                f"has another direction{at} than at first, and a tool moves along one line; keep "
                "the ratio of the components",
                self.key,
            )
        if size < -_ROUNDING * self.largest:
            raise InputError(
                f"is turned round{at}: a tool pushes and cannot pull, and nothing would stop the "
                "tool; a force of 0 lets the body go",
                self.key,
            )
        if self._translation:
            moved = self._vector(self._translation, time)
            if abs(moved @ self.direction) > _STRAIGHT * np.linalg.norm(moved):
                raise InputError(
                    f"is along foundation.motion at t = {time:g}: the force decides how far the "
                    "tool moves along it; leave out this component of the motion",
                    self.key,
                )
        return size if size > _ROUNDING * self.largest else 0.0

    def _require_facing(self) -> None:
        contact = self.contact
        towards = contact.free & (self.facing < -_FACING)
        if not on_any_rank(contact.surface.domain.comm, towards):
            raise InputError(
                "does not push the foundation towards the body: nothing would stop the foundation; "
                "the force acts on the foundation and points from it to the body",
                self.key,
            )


def _of_time(value: float | str, clock: Clock) -> Expression:
    return parse(value, (TIME,), tables=clock.tables)


def build_tools(
    contacts: Sequence[Contact], parameters: Parameters, clock: Clock
) -> tuple[PushedTool, ...]:
    """The tools among the foundations of the study file; collective.

    Raises InputError for a force that is zero at all times of the study, changes its direction, or
    does not push the tool towards the body.
    """
    times = (clock.now,) if parameters.steps is None else parameters.steps.planned
    found = []
    for contact, given in zip(contacts, parameters.contacts, strict=True):
        if given.foundation is not None and given.foundation.force is not None:
            found.append(PushedTool(contact, given.foundation, clock, times))
    for tool in found:
        tool.advance(clock.now)
    return tuple(found)
