"""The signed distance to a foundation, and its gradient.

A foundation is described by its signed distance ``phi(x)``, which is positive outside.  Linearised,
``phi(x + u) >= 0`` reads ``u . nu <= gap`` with ``gap = phi(x)`` and ``nu = -grad phi(x)``.  This
is the contact condition (5) with the normal of the foundation.  The linearisation is exact for a
half space; for a curved foundation its error is of second order in ``u``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from contact_locking.arrays import FloatArray
from contact_locking.laws.rigid_motion import RigidMotion


class Distance(Protocol):
    """A signed distance; its methods take points as an array (d, k)."""

    def gap(self, x: FloatArray) -> FloatArray:
        """``phi(x)`` (k,): the signed distance, negative inside the foundation."""

    def contact_normal(self, x: FloatArray) -> FloatArray:
        """``-grad phi(x)`` (d, k): unit vectors that point into the foundation."""


@dataclass(frozen=True)
class MovedDistance:
    """``phi(x) = phi_0(X)`` with the point X of the body at rest that is now at x."""

    body: Distance
    motion: RigidMotion

    def gap(self, x: FloatArray) -> FloatArray:
        return self.body.gap(self.motion.origin(x))

    def contact_normal(self, x: FloatArray) -> FloatArray:
        return self.motion.turn @ self.body.contact_normal(self.motion.origin(x))
