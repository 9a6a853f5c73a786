"""Rigid bodies that may stand in place of the gap: their shapes and their motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from contact_locking.values.concept import BodyKind, Components, Concept, Fault, Place, entry
from contact_locking.values.kinds import (
    LIST,
    SECTION,
    TEXT,
    Direction,
    Number,
    Point,
    Positive,
    Switch,
    TimedScalar,
    TimeScalar,
    TimeVector,
    ToolFile,
    list_or,
)
from contact_locking.values.value import Value
from contact_locking.values.wording import show

Rotation = Annotated[
    Annotated[tuple[TimeScalar, ...], Components(3), Tag(LIST)]
    | Annotated[TimeScalar, Tag(SECTION)],
    list_or(SECTION),
]


class Motion(Concept):
    """x = about + R (X - about) + translation, from rest: without motion x = X."""

    translation: TimeVector | None = entry(
        None, "components of the displacement; null: none", "length"
    )
    rotation: Rotation | None = entry(
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

    @property
    def angles(self) -> tuple[Value, ...] | None:
        """The components of the rotation, one in 2D and three in 3D."""
        if self.rotation is None or isinstance(self.rotation, tuple):
            return self.rotation
        return (self.rotation,)


MotionOrTranslation = Annotated[
    Annotated[Motion, Tag(SECTION)] | Annotated[TimeVector, Tag(LIST)], list_or(SECTION)
]


#: A longer polyline is not read.
MOST_CORNERS = 10_000


class HalfSpace(Concept):
    """(x - point) . normal <= 0."""

    point: Point = entry(..., "a point of its surface", "length")
    normal: Direction = entry(..., "normal of its surface, towards the body; of any length", "1")


class Sphere(Concept):
    """|x - centre| <= radius; a disc in 2D."""

    centre: Point = entry(..., "its centre", "length")
    radius: Positive = entry(..., "its radius", "length")


class Cylinder(Concept):
    """Distance of x from the line through ``centre`` along ``axis`` <= radius; a disc in 2D."""

    centre: Point = entry(..., "a point of its axis", "length")
    radius: Positive = entry(..., "its radius", "length")
    axis: Annotated[Direction, Components(3)] | None = entry(
        None, "its direction, in 3D only; null: [0, 1, 0]", "1"
    )

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if body.dim == 2 and self.axis is not None:
            yield Fault(("axis",), "must be left out in 2D")


class Surface(Concept):
    """A surface of triangles from a file; outside is where they run counterclockwise."""

    file: ToolFile = entry(
        ...,
        "an STL file, a Gmsh file with triangles, or a height map (.csv, .npy), relative to the "
        "study file",
    )
    spacing: tuple[Positive, Positive] | None = entry(
        None,
        "of a height map whose rows are heights: the distances dx of its columns and dy of its "
        "rows; null: its rows are x, y, z",
        "length",
    )
    scale: Positive = entry(1.0, "factor of its coordinates, such as 0.001 from mm to m", "1")
    shift: Annotated[tuple[Number, ...], Components(3)] | None = entry(
        None, "added to its coordinates after scale; null: nothing", "length"
    )
    turned: Switch = entry(False, "whether the other side of the triangles is outside")


_Corners = Annotated[
    tuple[Annotated[tuple[Number, ...], Components(2)], ...],
    Field(min_length=2, max_length=MOST_CORNERS),
    Tag(LIST),
]
CornersOrFile = Annotated[_Corners | Annotated[ToolFile, Tag(TEXT)], list_or(TEXT)]
SurfaceOrFile = Annotated[
    Annotated[Surface, Tag(SECTION)] | Annotated[ToolFile, Tag(TEXT)],
    Discriminator(lambda value: TEXT if isinstance(value, str) else SECTION),
]


class FoundationSpring(Concept):
    """A spring that holds the rigid body: the force -k q along a line for its travel q."""

    stiffness: Positive = entry(
        ..., "k, the force per travel; in 2D for a unit of thickness", "force/length"
    )
    along: Direction | None = entry(None, "its line, of any length; null: the line of force", "1")


class Foundation(Concept):
    """A rigid body that the deformed body does not enter: shape, motion, and forces on it."""

    half_space: HalfSpace | None = entry(None, "a half space")
    sphere: Sphere | None = entry(None, "a sphere, in 2D a disc")
    cylinder: Cylinder | None = entry(None, "a cylinder, in 2D a disc")
    expression: TimedScalar | None = entry(
        None, "signed distance as an expression of position and t, positive outside", "length"
    )
    polyline: CornersOrFile | None = entry(
        None,
        "in 2D the corners of its outline, or a CSV file with the columns x and y; the rigid body "
        "is on the left of the way from corner to corner",
        "length",
    )
    surface: SurfaceOrFile | None = entry(
        None, "in 3D a surface of triangles or a height map; a text is its file"
    )
    motion: MotionOrTranslation | None = entry(
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

    def _faults(self) -> Iterator[Fault]:
        given = [name for name in SHAPES if getattr(self, name) is not None]
        if len(given) != 1:
            listed = ", ".join(SHAPES)
            message = f"give exactly one of {listed}, not {' and '.join(given) or 'none'}"
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

    @property
    def shape(self) -> tuple[str, Any]:
        """The name of the shape, and its section or value."""
        given = next(name for name in SHAPES if getattr(self, name) is not None)
        value = getattr(self, given)
        if given == "surface" and isinstance(value, str):
            value = Surface(file=value)
        return given, value

    @property
    def file(self) -> str | None:
        _, value = self.shape
        if isinstance(value, Surface):
            return value.file
        return self.polyline if isinstance(self.polyline, str) else None

    @property
    def moved(self) -> Motion | None:
        """The motion as a section; None for a body at rest."""
        if isinstance(self.motion, tuple):
            return Motion(translation=self.motion)
        return self.motion

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if self.polyline is not None and body.dim != 2:
            yield Fault(("polyline",), "is for 2D; in 3D take surface")
        if self.surface is not None and body.dim != 3:
            yield Fault(("surface",), "is for 3D; in 2D take polyline")
        if body.axisymmetric:
            yield from self._revolution_faults()

    def _revolution_faults(self) -> Iterator[Fault]:
        """A shape or a motion that is not one of revolution about x = 0."""
        if self.cylinder is not None:
            message = "is no body of revolution about x = 0; take sphere, or half_space"
            yield Fault(("cylinder",), message)
        yield from _radial_faults(("force",), self.force)
        if self.spring is not None:
            yield from _radial_faults(("spring", "along"), self.spring.along)
        if self.moved is not None:
            where = ("motion",) if isinstance(self.motion, tuple) else ("motion", "translation")
            yield from _radial_faults(where, self.moved.translation)
            if self.moved.rotation is not None:
                message = "must be left out: an axisymmetric body has no rotation in its section"
                yield Fault(("motion", "rotation"), message)


def _radial_faults(place: Place, vector: Sequence[object] | None) -> Iterator[Fault]:
    if vector is not None and vector[0] != 0:
        message = f"must be 0 across the axis of an axisymmetric body, not {show(vector[0])}"
        yield Fault((*place, 0), message)


#: The keys of a foundation that describe a shape.
SHAPES = tuple(
    name for name in Foundation.model_fields if name not in ("motion", "force", "spring")
)
