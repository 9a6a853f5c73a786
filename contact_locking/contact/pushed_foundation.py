"""Rigid foundations that a prescribed force pushes against the body."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.errors import InputError
from contact_locking.parallel import maximum, minimum, on_any_rank

# A way below this share of the displacements is rounding.
_ROUNDING = 1e-12
# A foundation is pushed towards a node if its direction has at least this share along the contact
# normal.
_FACING = 1e-9


class PushedFoundation:
    """The foundation of a contact that the force ``F d`` pushes, with its travel q along d.

    The foundation is a rigid body.  Its displacement is ``q d`` with the unit vector d, and contact
    and friction limit ``u - q d`` in the place of u: ``(u - q d)_nu <= gap``.  The travel q is
    unknown.  In equilibrium the tractions on the body have the resultant F along d,

        int (sigma_nu nu + sigma_tau) . d = F >= 0.

    Across d, and in its rotations, the foundation follows its given motion, or stands still.
    ``force`` is F at present, and ``largest`` is the largest F that there will be.  Raises
    InputError for a force that does not push the foundation towards the body.
    """

    def __init__(self, contact: NodalContact) -> None:
        given = contact.given.force
        assert given is not None
        self.contact, self._given, self.key = contact, given, given.key
        self._travel = 0.0
        self.direction, self.largest = given.direction, given.largest
        self._require_facing()
        self.force = given.size()

    def advance(self) -> None:
        """Take the present force.  Raises InputError for a force that leaves its direction."""
        self.force = self._given.size()

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

    def _require_facing(self) -> None:
        contact = self.contact
        towards = contact.free & (self.facing < -_FACING)
        if not on_any_rank(contact.surface.domain.comm, towards):
            raise InputError(
                "does not push the foundation towards the body: nothing would stop the foundation; "
                "the force acts on the foundation and points from it to the body",
                self.key,
            )
