"""A rigid foundation: its shape, its motion, and the forces on it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Tag, create_model

from contact_locking.errors import with_key
from contact_locking.laws.rigid_motion import RigidMotion, rotation
from contact_locking.shapes import analytic as analytic
from contact_locking.shapes import faceted as faceted
from contact_locking.shapes.shape import SHAPES, Distance, Shape
from contact_locking.values.concept import (
    LIST,
    SECTION,
    BodyKind,
    Components,
    Concept,
    Fault,
    Place,
    entry,
    hidden,
)
from contact_locking.values.kinds import (
    Direction,
    Point,
    PositiveNumber,
    TimeScalar,
    TimeVector,
    components,
    list_or,
)
from contact_locking.values.value import Value, show, vector_at

if TYPE_CHECKING:
    pass

_Rotation = Annotated[
    Annotated[tuple[TimeScalar, ...], Components(3), Tag(LIST)]
    | Annotated[TimeScalar, Tag(SECTION)],
    list_or(SECTION),
    BeforeValidator(components),
]


class Motion(Concept):
    """``x = about + R (X - about) + translation`` for the points X of a foundation at rest.

    Each component is a number, an expression of t, or a constant of DOLFINx; without motion x = X.
    """

    translation: TimeVector | None = entry(
        None, "components of the displacement; null: none", "length"
    )
    rotation: _Rotation | None = entry(
        None, "angle, in 3D the components of a rotation vector; null: none", "rad"
    )
    about: Point | None = entry(
        None, "the point of the tool at rest about which the tool turns", "length"
    )

    def _faults(self) -> Iterator[Fault]:
        if self.translation is None and self.rotation is None:
            yield Fault((), "moves nothing: give translation, rotation or both")
        if (self.rotation is None) != (self.about is None):
            missing, there = ("about", "rotation") if self.about is None else ("rotation", "about")
            yield Fault((missing,), f"is missing beside {there}")

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if body.dim == 2 and isinstance(self.rotation, tuple):
            yield Fault(("rotation",), "is one angle in 2D, and no list")
        if body.dim == 3 and isinstance(self.rotation, Value):
            message = "is a vector with 3 components in 3D: the axis times the angle"
            yield Fault(("rotation",), message)
        if body.axisymmetric:
            yield from radial_faults(("translation",), self.translation)
            if self.rotation is not None:
                message = "must be left out: an axisymmetric body has no rotation in its section"
                yield Fault(("rotation",), message)

    def at(self, time: float, dim: int) -> RigidMotion:
        """The motion from rest at a time.  Raises InputError, with the key of a component."""
        zero = (Value.of(0.0),) * dim
        angles = self.rotation or zero[:1] * (1 if dim == 2 else 3)
        angles = angles if isinstance(angles, tuple) else (angles,)
        return RigidMotion(
            with_key("translation", lambda: vector_at(self.translation or zero, time)),
            rotation(with_key("rotation", lambda: vector_at(angles, time))),
            np.array(self.about or (0.0,) * dim, dtype=float),
        )


class FoundationSpring(Concept):
    """A spring that holds a foundation: ``-k q`` along a line for its travel q."""

    stiffness: PositiveNumber = entry(
        ..., "k, the force per travel; in 2D for a unit of thickness", "force/length"
    )
    along: Direction | None = entry(None, "its line, of any length; null: the line of force", "1")


_Moved = Annotated[
    Annotated[Motion, Tag(SECTION)] | Annotated[TimeVector, Tag(LIST)], list_or(SECTION)
]

_FIELDS: dict[str, Any] = {
    key: (shape | None, entry(None, shape.text, shape.unit)) for key, shape in SHAPES.items()
}
_Shapes: Any = create_model("_Shapes", __base__=Concept, **_FIELDS)


class Foundation(_Shapes):
    """A rigid body that the deformed body does not enter: shape, motion, and forces on it.

    The first argument of a script is a shape, or an object of its own with the methods of
    :class:`~contact_locking.shapes.shape.Distance`.
    """

    motion: _Moved | None = entry(
        None, "motion of the rigid body from rest; a list is the translation", "length"
    )
    force: TimeVector | None = entry(
        None,
        "components of the force that pushes the rigid body against the body: its displacement "
        "along the force is an unknown; null: the place of the rigid body is known",
        "force, in 2D force/length",
    )
    spring: FoundationSpring | None = entry(
        None,
        "the rigid body gives way along a line by force/stiffness, beyond its motion; a force is "
        "its preload; null: no spring",
    )
    own: Any = hidden("own")

    def __init__(self, shape: Distance | None = None, **named: Any) -> None:
        if shape is not None:
            key = shape.key if isinstance(shape, Shape) else ""
            named[key if key in _FIELDS else "own"] = shape
        super().__init__(**named)

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @property
    def shape(self) -> Distance:
        """The shape at rest."""
        return next(x for key in ("own", *_FIELDS) if (x := getattr(self, key)) is not None)

    @property
    def shape_key(self) -> str:
        """The key of the shape, empty for an object of a script's own."""
        return self.shape.key if isinstance(self.shape, Shape) else ""

    @property
    def file(self) -> str | None:
        """The file with the shape, if it is in one."""
        return getattr(self.shape, "file", None)

    @property
    def moved(self) -> Motion | None:
        """The motion with all its parts; None for a body at rest."""
        return Motion(self.motion) if isinstance(self.motion, tuple) else self.motion

    @property
    def is_free(self) -> bool:
        """Whether the place of the foundation is unknown: forces decide."""
        return self.force is not None or self.spring is not None

    def _faults(self) -> Iterator[Fault]:
        given = [key for key in (*_FIELDS, "own") if getattr(self, key) is not None]
        if len(given) != 1:
            listed = ", ".join(_FIELDS)
            message = f"give exactly one of {listed}, not {' and '.join(given) or 'none'}"
            yield Fault((), message)
        methods = ("gap", "contact_normal")
        is_distance = all(callable(getattr(self.own, name, None)) for name in methods)
        if self.own is not None and (isinstance(self.own, type) or not is_distance):
            message = (
                "must be a shape such as Sphere(centre, radius), or an object with gap(x) and "
                f"contact_normal(x), not {type(self.own).__name__}"
            )
            yield Fault((), message)
        if self.force is not None and all(component == 0 for component in self.force):
            message = "is zero, so that nothing pushes the foundation; leave it out for a fixed one"
            yield Fault(("force",), message)
        if self.spring is not None and (self.spring.along is None) == (self.force is None):
            message = (
                "is missing: the direction in which the spring gives way"
                if self.force is None
                else "is given twice: the spring acts along force; leave it out"
            )
            yield Fault(("spring", "along"), message)

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if not body.axisymmetric:
            return
        yield from radial_faults(("force",), self.force)
        if self.spring is not None:
            yield from radial_faults(("spring", "along"), self.spring.along)
        if isinstance(self.motion, tuple):
            yield from radial_faults(("motion",), self.motion)


def radial_faults(place: Place, vector: Sequence[object] | None) -> Iterator[Fault]:
    """A vector with a component across the axis of a body of revolution."""
    if vector is not None and vector[0] != 0:
        message = f"must be 0 across the axis of an axisymmetric body, not {show(vector[0])}"
        yield Fault((*place, 0), message)
