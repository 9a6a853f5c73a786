"""Foundations that a force or a spring moves: how far each travels, and the set of all of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.contact.contact import FoundationSpring
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.errors import InputError, with_key
from contact_locking.parallel import maximum, minimum, on_any_rank
from contact_locking.values.value import Value, vector_at

# A force below this share of the largest force is zero with rounding, as in sin(pi*t) at t = 1.
_NO_FORCE = 1e-12
# The share of the largest force by which the force may leave its line.
_STRAIGHT = 1e-9
# A distance below this share of the displacements is rounding.
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

    Raises InputError for a force that is zero at all times, changes its direction or does not push
    the foundation towards the body, and for a spring along the surface of the body.  The
    constructor is collective.
    """

    def __init__(self, contact: NodalContact) -> None:
        self.contact, self.force, self.stiffness = contact, 0.0, 0.0
        foundation, clock = contact.concept.foundation, contact.clock
        assert foundation is not None
        self._spring: FoundationSpring | None = foundation.spring
        self._force: Sequence[Value] = foundation.force or ()
        self.key = f"{contact.key}.foundation.{'force' if self._force else 'spring'}"
        self.largest = 0.0
        self.direction: FloatArray = np.zeros(contact.surface.domain.dim)
        # Motion along a spring moves its far end.
        moved = None if foundation.spring is not None else foundation.moved
        self._translation: Sequence[Value] = () if moved is None else moved.translation or ()
        if self._force:
            is_timed = any(value.expression and value.is_timed for value in self._force)
            times = clock.planned or (clock.some_times if is_timed else [clock.now])
            forces = np.array([self._vector(self._force, time) for time in times])
            sizes = np.linalg.norm(forces, axis=1)
            self.largest = float(sizes.max())
            if self.largest == 0.0:
                raise InputError(
                    "is zero at all times, so that nothing pushes the foundation; leave it out for "
                    "a fixed foundation",
                    self.key,
                )
            first = int(np.argmax(sizes > _NO_FORCE * self.largest))
            self.direction = forces[first] / sizes[first]
            for time in times:
                self._size(time)
        else:
            assert self._spring is not None
            along = np.asarray(self._spring.along, dtype=float)
            self.direction = along / np.linalg.norm(along)
            if contact.surface.integral(contact.free * self.facing) > 0.0:
                self.direction = 0.0 - self.direction
        if not on_any_rank(contact.surface.domain.comm, self._towards):
            if self._force:
                raise InputError(
                    "does not push the foundation towards the body: nothing would stop the "
                    "foundation; the force acts on the foundation and points from it to the body",
                    self.key,
                )
            raise InputError(
                "is along the surface of the body, so that contact does not load it; give the "
                "direction in which the foundation moves",
                f"{self.key}.along",
            )
        self.advance()

    def _vector(self, components: Sequence[Value], time: float) -> FloatArray:
        return with_key(self.key, lambda: vector_at(components, time))

    def _size(self, time: float) -> float:
        """F at a time.  Raises InputError for a force that leaves its direction."""
        force = self._vector(self._force, time)
        size = float(force @ self.direction)
        at = f" at t = {time:g}" if any(value.is_timed for value in self._force) else ""
        if np.linalg.norm(force - size * self.direction) > _STRAIGHT * self.largest:
            raise InputError(
                f"has another direction{at} than at first, and a foundation moves along one line; "
                "keep the ratio of the components",
                self.key,
            )
        if size < -_NO_FORCE * self.largest:
            raise InputError(
                f"changes its sign{at}: a foundation pushes and cannot pull, and nothing would "
                "stop the foundation; a force of 0 releases the body",
                self.key,
            )
        if self._translation:
            moved = self._vector(self._translation, time)
            if abs(moved @ self.direction) > _STRAIGHT * np.linalg.norm(moved):
                raise InputError(
                    f"is along foundation.motion at t = {time:g}: the force decides how far the "
                    "foundation moves along it; leave out this component of the motion",
                    self.key,
                )
        return size if size > _NO_FORCE * self.largest else 0.0

    def advance(self) -> None:
        """Update force and spring to the time.  Raises InputError for values of no use."""
        if self._force:
            self.force = self._size(self.contact.clock.now)
        if self._spring is not None:
            key = f"{self.contact.key}.foundation.spring.stiffness"
            self.stiffness = float(vector_at([self._spring.stiffness], self.contact.clock.now)[0])
            if not (np.isfinite(self.stiffness) and self.stiffness >= 0.0):
                raise InputError(f"must be a number from 0 up, not {self.stiffness:g}", key)

    @property
    def acts(self) -> bool:
        """Whether a force or a spring presses the foundation on a body in its way at present."""
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
        """The travel q at which the foundation touches the body displaced by u; collective.

        A foundation stays there when its force falls to zero.
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
        summary = {"force": self.force, "direction": direction, "travel": size + 0.0}
        if self._spring is not None:
            summary["spring_force"] = 0.0 - self.stiffness * size
        return summary

    @property
    def _towards(self) -> BoolArray:
        """The nodes (k,) that the foundation comes nearer to."""
        return np.asarray(self.contact.free & (self.facing < -_FACING))


class Tools(Sequence[Travel]):
    """All free foundations with their travels at present."""

    def __init__(self, tools: Sequence[Travel]) -> None:
        self._tools, self._travels = tuple(tools), (0.0,) * len(tools)

    def __len__(self) -> int:
        return len(self._tools)

    def __getitem__(self, number: Any) -> Any:
        return self._tools[number]

    @property
    def travels(self) -> tuple[float, ...]:
        """The size q of each travel; setting them moves the foundations."""
        return self._travels

    @travels.setter
    def travels(self, values: Sequence[float]) -> None:
        self._travels = tuple(map(float, values))
        for tool, size in zip(self, self._travels, strict=True):
            tool.contact.move_foundation(size * tool.direction)

    @property
    def forces(self) -> FloatArray:
        """The force F (T,) on the foundations at present."""
        return np.array([tool.force for tool in self])

    @property
    def stiffnesses(self) -> FloatArray:
        """The stiffness k (T,) of the springs at present."""
        return np.array([tool.stiffness for tool in self])

    @property
    def unbalanced(self) -> FloatArray:
        """``F - k q`` (T,): the forces that the contacts have to bear."""
        return self.forces - self.stiffnesses * np.array(self._travels)

    @property
    def act(self) -> bool:
        """Whether any of them :attr:`acts <Travel.acts>` at present."""
        return any(tool.acts for tool in self)

    def update_unloaded(self, u: fem.Function) -> None:
        """Move foundations without a force until they touch the body; collective."""
        travels = []
        for tool, size in zip(self, self._travels, strict=True):
            if not tool.acts:
                tool.contact.move_foundation(np.zeros_like(tool.direction))
            travels.append(size if tool.acts else tool.touching(u))
        self.travels = tuple(travels)
