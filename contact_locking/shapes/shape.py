"""The base class of shapes of foundations: a signed distance, at rest or moved as a rigid body.

A foundation is described by its signed distance ``phi(x)``, which is positive outside.  Linearised,
``phi(x + u) >= 0`` reads ``u . nu <= gap`` with ``gap = phi(x)`` and ``nu = -grad phi(x)``.  This
is the contact condition (5) with the normal of the foundation.  The linearisation is exact for a
half space; for a curved foundation its error is of second order in ``u``.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np
from pydantic import ValidationInfo, model_validator

from contact_locking.arrays import FloatArray
from contact_locking.findings import Finding
from contact_locking.values.concept import ONLY, Concept

if TYPE_CHECKING:
    from mpi4py import MPI


@dataclass(frozen=True)
class RigidMotion:
    """``x = about + R (X - about) + translation`` for the points X of a foundation at rest.

    ``translation`` and ``about`` are (d,), and ``turn`` (d, d) is the rotation R.  The point
    ``about`` moves by the translation alone.
    """

    translation: FloatArray
    turn: FloatArray
    about: FloatArray

    @classmethod
    def rest(cls, dim: int) -> RigidMotion:
        """The motion that moves nothing."""
        return cls(np.zeros(dim), np.eye(dim), np.zeros(dim))

    def moved(self, points: FloatArray) -> FloatArray:
        """The present places of the points X (d, k) of the foundation at rest."""
        about = self.about[:, None]
        return about + self.turn @ (points - about) + self.translation[:, None]

    def origin(self, places: FloatArray) -> FloatArray:
        """The points X (d, k) of the foundation at rest that are now at ``places`` (d, k)."""
        about = self.about[:, None]
        return about + self.turn.T @ (places - about - self.translation[:, None])

    def step_from(self, before: RigidMotion, places: FloatArray) -> FloatArray:
        """The way (d, k) of the points of the foundation at ``places`` since ``before``."""
        return self.moved(before.origin(places)) - places


def skew(axis: FloatArray) -> FloatArray:
    """The skew matrix of ``x -> axis x x``, for an axis (1,) across the plane or (3,) in space."""
    if len(axis) == 1:
        return np.array([[0.0, -axis[0]], [axis[0], 0.0]])
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation(angles: FloatArray) -> FloatArray:
    """The rotation R by an angle (1,) in the plane, or by a rotation vector (3,), in radians.

    In space ``R = exp([w])`` by Rodrigues' formula, a turn by the angle ``|w|`` about w.
    """
    if len(angles) == 1:
        cosine, sine = np.cos(angles[0]), np.sin(angles[0])
        return np.array([[cosine, -sine], [sine, cosine]])
    angle = float(np.linalg.norm(angles))
    cross = skew(angles)
    # sin(a)/a and (1 - cos(a))/a^2, which have limits at a = 0.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


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


#: The shapes by their keys in a study file.
SHAPES: dict[str, type[Shape]] = {}


class Shape(Concept):
    """A signed distance ``phi(x)``.

    ``key`` is the key of the shape in a study file, ``text`` and ``unit`` its description there.
    ``is_distance`` says that phi is exact everywhere, so that it changes by no more than the way.
    ``turn`` says how to turn it if it is inside out, and ``turn_normal`` if it lies behind the
    body.
    """

    key: ClassVar[str] = ""
    text: ClassVar[str] = ""
    unit: ClassVar[str] = ""
    is_distance: ClassVar[bool] = True
    is_plane: ClassVar[bool] = False
    turn: ClassVar[str] = ""
    turn_normal: ClassVar[str] = ""

    @classmethod
    def __pydantic_init_subclass__(cls, **options: Any) -> None:
        if "key" in cls.__dict__:
            SHAPES[cls.key] = cls

    @model_validator(mode="before")
    @classmethod
    def _from_value(cls, data: Any, info: ValidationInfo) -> Any:
        """A shape that is one value stands in a study file without a mapping."""
        is_short = ONLY in {field.alias for field in cls.model_fields.values()}
        is_value = info.context is not None or not isinstance(data, dict)
        return {ONLY: data} if is_short and is_value and not isinstance(data, cls) else data

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> Any:
        schema = handler(core)
        resolved = handler.resolve_ref_schema(schema)
        if (value := resolved["properties"].get(ONLY)) is not None:
            resolved.clear()
            resolved.update(value)
        return schema

    @abstractmethod
    def gap(self, x: FloatArray) -> FloatArray:
        """``phi(x)`` (k,) at points (d, k): the signed distance, negative inside."""

    @abstractmethod
    def contact_normal(self, x: FloatArray) -> FloatArray:
        """``-grad phi(x)`` (d, k): unit vectors that point into the foundation."""

    def read(self, comm: MPI.Intracomm) -> Shape:
        """The shape with what is in its files; collective."""
        return self

    @property
    def is_timed(self) -> bool:
        """Whether the shape itself changes with the time."""
        return False

    def at(self, time: float) -> Distance:
        """The shape at a time."""
        return self

    @property
    def findings(self) -> list[Finding]:
        """Findings about a shape, without a key."""
        return []


class OwnShape(Shape):
    """The signed distance of an object that a script defines."""

    is_distance = False
    turn_normal = ", or turn its contact_normal, which points into the foundation"

    distance: Any

    def gap(self, x: FloatArray) -> FloatArray:
        return self.distance.gap(x)

    def contact_normal(self, x: FloatArray) -> FloatArray:
        return self.distance.contact_normal(x)
