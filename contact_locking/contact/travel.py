"""The travel of a foundation that a force or a spring moves along a line."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.contact.rigid_body import FoundationSpring, Push
from contact_locking.errors import InputError
from contact_locking.parallel import maximum, minimum, on_any_rank
from contact_locking.values.value import vector_at

# A way below this share of the displacements is rounding.
_ROUNDING = 1e-12
# A foundation is pushed towards a node if its direction has at least this share along the contact
# normal.
_FACING = 1e-9


class Travel:
    """The displacement ``q d`` of a foundation along a unit vector d, whose size q is an unknown.

    Contact and friction limit ``u - q d`` in the place of u: ``(u - q d)_nu <= gap``.  With a force
    ``F d`` and a spring k on the foundation the tractions on the body are in equilibrium if

        int (sigma_nu nu + sigma_tau) . d + k q = F.

    Across d the foundation follows its given motion, or stands still.  ``force`` is F at present,
    ``largest`` the largest F that there will be, ``stiffness`` is k at present, and ``key`` names
    the travel in messages.  The sizes q are those of ``Tools``.

    Raises InputError for a force that does not push the foundation towards the body, and for a
    spring along the surface of the body.  The constructor is collective.
    """

    def __init__(self, contact: NodalContact) -> None:
        self.contact, self.force, self.stiffness = contact, 0.0, 0.0
        foundation, key = contact.given.foundation, f"{contact.key}.foundation"
        assert foundation is not None
        self._spring: FoundationSpring | None = foundation.spring
        self._push: Push | None = None
        if foundation.force is not None:
            self._push = push = Push(foundation, f"{key}.force", contact.clock)
            self.key, self.largest, self.direction = push.key, push.largest, push.direction
        else:
            assert self._spring is not None
            self.key, self.largest = f"{key}.spring", 0.0
            along = np.asarray(self._spring.along, dtype=float)
            self.direction = along / np.linalg.norm(along)
            if contact.surface.integral(contact.free * self.facing) > 0.0:
                self.direction = 0.0 - self.direction
        self._require_facing()
        self.advance()

    def advance(self) -> None:
        """Take the present force and spring.  Raises InputError for unfit ones."""
        if self._push is not None:
            self.force = self._push.size()
        if self._spring is not None:
            key = f"{self.contact.key}.foundation.spring.stiffness"
            self.stiffness = float(vector_at([self._spring.stiffness], self.contact.clock.now)[0])
            if not (np.isfinite(self.stiffness) and self.stiffness >= 0.0):
                raise InputError(f"must be a number from 0 up, not {self.stiffness:g}", key)

    @property
    def acts(self) -> bool:
        """Whether the foundation presses on the body, if it is in the way, at present."""
        return self.force > 0.0 or self.is_sprung

    @property
    def is_sprung(self) -> bool:
        """Whether a spring gives the foundation a place of its own."""
        return self.stiffness > 0.0

    @property
    def facing(self) -> FloatArray:
        """``d . nu`` (k,) at the nodes, below zero where the foundation comes nearer."""
        return np.asarray(np.sum(self.contact.normals * self.direction, axis=1))

    def resultant(self, pressure: FloatArray, traction: FloatArray) -> tuple[float, float]:
        """``int (sigma_tau - p nu) . d`` of nodal p (k,) and ``sigma_tau`` (k, d); collective.

        There is no pressure at held nodes.  The second number is the integral of the magnitudes.
        """
        contact = self.contact
        along = np.sum(traction * self.direction, axis=1)
        along -= contact.free * pressure * self.facing
        integral = contact.surface.integral
        return float(integral(along)), float(integral(np.abs(along)))

    def touching(self, u: fem.Function) -> float:
        """How far the foundation travels until it touches the body with a displacement; collective.

        This is where a force leaves the foundation that falls to zero.
        """
        contact, towards = self.contact, self._towards
        room = contact.gaps - contact.split(u)[0]
        comm = contact.surface.domain.comm
        nearest = minimum(comm, room[towards] / -self.facing[towards])
        # Rounding must not leave a pressure.
        size = maximum(comm, np.abs(u.x.array)) + maximum(comm, np.abs(contact.gaps))
        return nearest - _ROUNDING * size

    def summary(self, size: float) -> dict[str, Any]:
        """The force F, the unit vector d, the travel q, and -k q with a spring."""
        direction = [float(x) + 0.0 for x in self.direction]
        found = {"force": self.force, "direction": direction, "travel": size + 0.0}
        if self._spring is not None:
            found["spring_force"] = 0.0 - self.stiffness * size
        return found

    @property
    def _towards(self) -> BoolArray:
        """The nodes (k,) that the foundation comes nearer to."""
        return np.asarray(self.contact.free & (self.facing < -_FACING))

    def _require_facing(self) -> None:
        if on_any_rank(self.contact.surface.domain.comm, self._towards):
            return
        if self._push is None:
            raise InputError(
                "is along the surface of the body, so that contact does not load it; give the "
                "direction in which the foundation gives way",
                f"{self.key}.along",
            )
        raise InputError(
            "does not push the foundation towards the body: nothing would stop the foundation; "
            "the force acts on the foundation and points from it to the body",
            self.key,
        )
