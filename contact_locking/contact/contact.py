"""The data of a contact: place, foundation and friction."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

import numpy as np
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray, present, values_at
from contact_locking.contact.coulomb import Coulomb
from contact_locking.contact.foundation import PlacedFoundation
from contact_locking.errors import InputError
from contact_locking.laws.foundation import Foundation
from contact_locking.laws.rigid_motion import RigidMotion, rotation
from contact_locking.mesh.domain import Where


@dataclass(frozen=True)
class Gap:
    """``u_nu <= g``: a foundation at a distance along the outward normal nu of the body.

    ``distance`` is g, a length: a number, a constant of DOLFINx, or a function of points (d, k)
    with values (k,).
    """

    distance: float | fem.Constant | Callable[[FloatArray], FloatArray] = 0.0

    def at(self, x: FloatArray) -> FloatArray:
        """The gap (k,) at points (d, k)."""
        return values_at(self.distance, x)


@dataclass
class Motion:
    """``x = about + R (X - about) + translation`` for the points X of a foundation at rest.

    ``translation`` and ``about`` are (d,), lengths.  ``rotation`` is an angle in 2D and a rotation
    vector (3,) in 3D, in radians.  Each is numbers, or a constant of DOLFINx; each solve reads the
    present values.
    """

    translation: Sequence[float] | fem.Constant
    rotation: float | Sequence[float] | fem.Constant | None = None
    about: Sequence[float] | fem.Constant | None = None

    def __call__(self) -> RigidMotion:
        translation = np.atleast_1d(present(self.translation))
        dim = len(translation)
        angles = np.zeros(1) if self.rotation is None else np.atleast_1d(present(self.rotation))
        about = np.zeros(dim) if self.about is None else present(self.about)
        if about.shape != translation.shape:
            raise InputError(f"about must have {dim} components, as translation has", "motion")
        if self.rotation is not None and len(angles) != (1 if dim == 2 else 3):
            wanted = "one angle in 2D" if dim == 2 else "a rotation vector (3,) in 3D"
            raise InputError(f"rotation must be {wanted}", "motion")
        turn = np.eye(dim) if self.rotation is None else rotation(angles)
        return RigidMotion(translation, turn, about)


class Pushing(Protocol):
    """A force ``F d``, F >= 0, that pushes a foundation along a line with the unit vector d.

    ``direction`` (d,) is d, ``largest`` is the largest F that there will be, and ``key`` names the
    force in messages.
    """

    direction: FloatArray
    largest: float
    key: str

    def size(self) -> float:
        """F at present."""


class Force:
    """A constant line of force; ``vector`` (d,) may change its length between two solves.

    Raises InputError for a vector that is zero at first, and later for one along another line.
    """

    def __init__(self, vector: Sequence[float], key: str = "force") -> None:
        if isinstance(vector, Expr):
            raise InputError("is of numbers; set its vector[:] between two solves", key)
        self.vector: FloatArray = np.array(vector, dtype=float)
        self.key, self.largest = key, float(np.linalg.norm(self.vector))
        if not (np.isfinite(self.largest) and self.largest > 0.0):
            raise InputError("needs a length above zero at first, which gives its line", key)
        self.direction: FloatArray = np.asarray(self.vector / self.largest, dtype=float)

    def size(self) -> float:
        size = float(self.vector @ self.direction)
        if np.linalg.norm(self.vector - size * self.direction) > 1e-9 * self.largest or size < 0.0:
            raise InputError(
                f"{self.vector.tolist()} is not along {self.direction.tolist()}: a foundation is "
                "pushed along one line",
                self.key,
            )
        return size


@dataclass(frozen=True)
class FoundationSpring:
    """A spring that holds a foundation: ``-k q`` along a line for the travel q of the foundation.

    ``stiffness`` is k, a force per length, in 2D per length of the third dimension.  ``along``
    (d,), of any length, gives the line; without it the line is that of the force on the foundation.
    """

    stiffness: float | fem.Constant
    along: Sequence[float] | None = None


@dataclass(frozen=True)
class Contact:
    """``u_nu <= gap``, ``sigma_nu <= 0``, ``(u_nu - gap) sigma_nu = 0`` (5) and friction (6).

    ``on`` is the possible place of contact: names of boundary parts, local indices of exterior
    facets (k,), or a pair of mesh tags and a value.  ``foundation`` is a :class:`Gap`, an object
    with the methods of :class:`~contact_locking.laws.foundation.Foundation`, or a foundation that
    has been placed.  ``motion``, such as a :class:`Motion`, is a function that each solve calls for
    the motion of the foundation from rest; without it the foundation rests.  ``force`` pushes the
    foundation, which then moves along the line of the force until it is in equilibrium; with a
    ``spring`` it gives way as far as the spring lets it.  ``key`` names the contact in messages.

    ``against`` is the place of another side, of another body on the same mesh or of the same one;
    it has no node of ``on`` but at the tip of a crack.  Contact then limits the jump
    ``[u] = u - u o chi`` between the sides, with the points chi(x) of ``against`` that the normals
    of ``on`` meet.  A :class:`Gap` adds to the distance of the sides: below zero they overlap and
    press, as in a press fit.  ``pair`` says where these points and the contact normals are found:
    "each_step" at the solution of each step, or "once" on the undeformed mesh, as the linear theory
    has them.

    ``name`` stands for the contact in summary, history and charts; without one it is the first of
    ``on``.
    """

    on: Where
    foundation: Foundation | Gap | PlacedFoundation = field(default_factory=Gap)
    friction: Coulomb = field(default_factory=Coulomb)
    motion: Callable[[], RigidMotion] | None = None
    force: Pushing | None = None
    key: str = "contact"
    against: Where | None = None
    pair: Literal["once", "each_step"] = "each_step"
    spring: FoundationSpring | None = None
    name: str = ""

    @property
    def is_free(self) -> bool:
        """Whether the place of the foundation is unknown: forces decide."""
        return self.force is not None or self.spring is not None


def named(contacts: Sequence[Contact]) -> list[Contact]:
    """The contacts, each with a name of its own: that of its first boundary part if it has none.

    Raises InputError for a name that two contacts have.
    """
    taken: set[str] = set()
    for contact in contacts:
        if contact.name in taken:
            raise InputError(f"'{contact.name}' is the name of another contact", contact.key)
        taken |= {contact.name} - {""}
    found = []
    for contact in contacts:
        # The names are parts of dotted keys.
        first = str(next(iter(contact.on))).replace(".", "_")
        others = (f"{first}_{number}" for number in itertools.count(2))
        free = (name for name in itertools.chain([first], others) if name not in taken)
        name = contact.name or next(free)
        taken.add(name)
        found.append(replace(contact, name=name))
    return found
