"""The ways in which a foundation moves by itself: along a force or a spring, and about a pivot."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray, present
from contact_locking.contact.contact import Tilt
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.errors import InputError
from contact_locking.laws.rigid_motion import SmallMotion, axis_of, skew
from contact_locking.parallel import maximum, minimum, on_any_rank

# A way below this share of the displacements is rounding.
_ROUNDING = 1e-12
# A foundation is pushed towards a node if its direction has at least this share along the contact
# normal.
_FACING = 1e-9
# A turn whose displacements have a smaller share along the contact normals leaves the foundation
# where it is, as that of a plane about its normal.
_TURNS = 1e-9
# One of the axes of space has at least this share apart from fewer than all axes that are wanted.
_APART = 0.5


class FreeMotion(ABC):
    """A rigid motion m of a foundation, whose size q is an unknown.

    The displacement of the foundation is ``q m(x)``, and contact and friction limit ``u - q m`` in
    the place of u: ``(u - q m)_nu <= gap``.  With a force F and a spring k on the foundation the
    tractions on the body are in equilibrium if

        int (sigma_nu nu + sigma_tau) . m + k q = F.

    A foundation may have several of these motions, and has the sum of their displacements.  In all
    other ways it follows its given motion, or stands still.  ``key`` names the motion in messages.
    The sizes q are those of ``Tools``.
    """

    def __init__(self, contact: NodalContact, key: str) -> None:
        self.contact, self.key = contact, key

    #: F at present, and the largest F that there will be.
    force: float = 0.0
    largest: float = 0.0
    #: k at present.
    stiffness: float = 0.0

    @property
    @abstractmethod
    def motion(self) -> SmallMotion:
        """The motion m at present."""

    @property
    @abstractmethod
    def acts(self) -> bool:
        """Whether the foundation presses on the body, if it is in the way, at present."""

    @abstractmethod
    def advance(self) -> None:
        """Take the present force and spring; collective.  Raises InputError for unfit ones."""

    @abstractmethod
    def summary(self, size: float) -> tuple[str, dict[str, Any]]:
        """The key in an entry of ``contacts`` of summary.json, and the results below it."""

    @property
    def is_sprung(self) -> bool:
        """Whether a spring gives the foundation a place of its own."""
        return self.stiffness > 0.0

    @property
    def field(self) -> FloatArray:
        """The limited values (k, d) of the motion m."""
        return self.motion.at(self.contact.surface.points)

    @property
    def facing(self) -> FloatArray:
        """``m . nu`` (k,) at the nodes, below zero where the foundation comes nearer."""
        return np.asarray(np.sum(self.contact.normals * self.field, axis=1))

    @property
    def reach(self) -> float:
        """The largest ``|m|`` at the nodes; collective."""
        return maximum(self.contact.surface.domain.comm, np.linalg.norm(self.field, axis=1))

    def resultant(self, pressure: FloatArray, traction: FloatArray) -> tuple[float, float]:
        """``int (sigma_tau - p nu) . m`` of nodal p (k,) and ``sigma_tau`` (k, d); collective.

        There is no pressure at held nodes.  The second number is the integral of the magnitudes.
        """
        contact = self.contact
        along = np.sum(traction * self.field, axis=1) - contact.free * pressure * self.facing
        integral = contact.surface.integral
        return float(integral(along)), float(integral(np.abs(along)))


class Travel(FreeMotion):
    """The travel q along a unit vector d: ``m = d``, with a force ``F d`` or a spring.

    Raises InputError for a force that does not push the foundation towards the body, and for a
    spring along the surface of the body.
    """

    def __init__(self, contact: NodalContact) -> None:
        self._given, self._spring = contact.given.force, contact.given.spring
        key = self._given.key if self._given else f"{contact.key}.foundation.spring"
        super().__init__(contact, key)
        if self._given is not None:
            self.direction, self.largest = self._given.direction, self._given.largest
        else:
            assert self._spring is not None
            along = np.asarray(self._spring.along, dtype=float)
            self.direction = along / np.linalg.norm(along)
            surface = contact.surface
            if surface.integral(contact.free * self.facing) > 0.0:
                self.direction = 0.0 - self.direction
        self._require_facing()
        self.advance()

    def advance(self) -> None:
        if self._given is not None:
            self.force = self._given.size()
        if self._spring is not None:
            key = f"{self.contact.key}.foundation.spring"
            self.stiffness = _stiffness(self._spring.stiffness, key)

    @property
    def motion(self) -> SmallMotion:
        dim = len(self.direction)
        return SmallMotion(self.direction, np.zeros((dim, dim)))

    @property
    def acts(self) -> bool:
        return self.force > 0.0 or self.is_sprung

    def touching(self, u: fem.Function) -> float:
        """How far the foundation travels until it touches the body with a displacement; collective.

        This is where a force leaves the foundation that falls to zero.
        """
        contact = self.contact
        towards = contact.free & (self.facing < -_FACING)
        room = contact.gaps - contact.split(u)[0]
        comm = contact.surface.domain.comm
        nearest = minimum(comm, room[towards] / -self.facing[towards])
        # Rounding must not leave a pressure.
        size = maximum(comm, np.abs(u.x.array)) + maximum(comm, np.abs(contact.gaps))
        return nearest - _ROUNDING * size

    def summary(self, size: float) -> tuple[str, dict[str, Any]]:
        """The force F, the unit vector d, the travel q, and -k q with a spring."""
        direction = [float(x) + 0.0 for x in self.direction]
        found = {"force": self.force, "direction": direction, "travel": size + 0.0}
        if self._spring is not None:
            found["spring_force"] = 0.0 - self.stiffness * size
        return "tool", found

    def _require_facing(self) -> None:
        contact = self.contact
        towards = contact.free & (self.facing < -_FACING)
        if on_any_rank(contact.surface.domain.comm, towards):
            return
        if self._given is None:
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


class Turn(FreeMotion):
    """A turn by the small angle q about an axis through a pivot a: ``m(x) = w x (x - a)``.

    The axis w is a unit vector, across the plane in 2D.  Without a spring the tractions have no
    moment about the axis.  The pivot follows the given motion of the foundation.  ``beside`` is the
    travel of the same foundation, if it has one.
    """

    def __init__(
        self, contact: NodalContact, tilt: Tilt, axis: FloatArray, beside: Travel | None
    ) -> None:
        super().__init__(contact, f"{contact.key}.foundation.tilt")
        self.axis, self._tilt, self._beside = axis, tilt, beside
        self.advance()

    def advance(self) -> None:
        self.stiffness = _stiffness(self._tilt.stiffness, self.key)
        about = present(self._tilt.about)[:, None]
        pivot = self.contact.foundation.motion().place(about)[:, 0]
        self._motion = SmallMotion.about(pivot, skew(self.axis))
        self._require_two_sides()

    @property
    def motion(self) -> SmallMotion:
        return self._motion

    @property
    def acts(self) -> bool:
        return self._beside is None or self._beside.acts

    def summary(self, size: float) -> tuple[str, dict[str, Any]]:
        """The pivot at rest, the angle, and the moment -k q about the pivot."""
        # The turns about all axes.
        angle = axis_of(self.contact.travel.turn)
        found: dict[str, Any] = {"angle": _plain(angle), "moment": _plain(-self.stiffness * angle)}
        return "tilt", {"about": [float(x) for x in present(self._tilt.about)], **found}

    def _require_two_sides(self) -> None:
        if self.is_sprung:
            return
        contact, comm = self.contact, self.contact.surface.domain.comm
        facing = self.facing[contact.free]
        least, most = minimum(comm, facing), maximum(comm, facing, -np.inf)
        if not least < 0.0 < most:
            raise InputError(
                "lies beside the place of contact: the foundation would turn away from the body, "
                "and no pressure would stop it; give a point that the body has on both sides",
                f"{self.key}.about",
            )


def free_motions(contact: NodalContact) -> list[FreeMotion]:
    """The free motions of the foundation of a contact, none for one in a known place; collective.

    Raises InputError for those that nothing would stop.
    """
    given = contact.given
    goes = given.force is not None or given.spring is not None
    travel = Travel(contact) if goes else None
    found: list[FreeMotion] = [] if travel is None else [travel]
    if given.tilt is not None:
        axes = _axes(contact, given.tilt)
        found += [Turn(contact, given.tilt, axis, travel) for axis in axes]
    return found


def _axes(contact: NodalContact, tilt: Tilt) -> FloatArray:
    """The axes (m, 1 | 3) of turns about a pivot that move the foundation to or from the body.

    Collective.  A turn that slides the foundation along itself alone is left out.
    """
    surface = contact.surface
    about = contact.foundation.motion().place(present(tilt.about)[:, None])[:, 0]
    axes = np.eye(1 if surface.domain.dim == 2 else 3)
    arms = [SmallMotion.about(about, skew(axis)).at(surface.points) for axis in axes]
    facing = np.array([np.sum(contact.normals * arm, axis=1) for arm in arms]) * contact.free
    gram = surface.domain.comm.allreduce(facing * surface.weights @ facing.T)
    values, vectors = np.linalg.eigh(gram)
    kept = values > _TURNS * sum(float(np.sum(surface.integral(arm**2))) for arm in arms)
    if not kept.any():
        raise InputError(
            "is a point about which the foundation turns without moving to or from the body; "
            "give another point, or leave out the tilt",
            f"{contact.key}.foundation.tilt.about",
        )
    # Eigenvectors of equal eigenvalues are those of the rounding: these axes are not.
    projection = vectors[:, kept] @ vectors[:, kept].T
    found: list[FloatArray] = []
    for column in projection:
        rest = column - sum((axis * (axis @ column) for axis in found), np.zeros_like(column))
        if len(found) < kept.sum() and np.linalg.norm(rest) >= _APART:
            found.append(rest / np.linalg.norm(rest))
    return np.array(found)


def _plain(values: Any) -> float | list[float]:
    """A number in 2D, and the components in 3D."""
    found = [float(x) + 0.0 for x in values]
    return found[0] if len(found) == 1 else found


def _stiffness(given: float | fem.Constant, key: str) -> float:
    """The stiffness k at present.  Raises InputError unless it is a number from 0 up."""
    found = float(present(given))
    if not (np.isfinite(found) and found >= 0.0):
        raise InputError(f"must be a number from 0 up, not {found:g}", f"{key}.stiffness")
    return found
