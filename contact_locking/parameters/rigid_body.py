"""Rigid bodies that may stand in place of the gap: half spaces, spheres and cylinders."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import model_validator

from .base import Fault, Section, entry, refuse_if, vector_faults
from .values import Number, Positive, TimeScalar
from .wording import show


class HalfSpace(Section):
    """(x - point) . normal <= 0."""

    point: tuple[Number, ...] = entry(..., "a point of its surface", "length")
    normal: tuple[Number, ...] = entry(
        ..., "normal of its surface, towards the body; of any length", "1"
    )

    @model_validator(mode="after")
    def _check(self) -> HalfSpace:
        refuse_if(_zero_faults("normal", self.normal))
        return self


class Sphere(Section):
    """|x - centre| <= radius; a disc in 2D."""

    centre: tuple[Number, ...] = entry(..., "its centre", "length")
    radius: Positive = entry(..., "its radius", "length")


class Cylinder(Section):
    """Distance of x from the line through ``centre`` along ``axis`` <= radius; a disc in 2D."""

    centre: tuple[Number, ...] = entry(..., "a point of its axis", "length")
    radius: Positive = entry(..., "its radius", "length")
    axis: tuple[Number, ...] | None = entry(
        None, "its direction, in 3D only; null: [0, 1, 0]", "1", optional=True
    )

    @model_validator(mode="after")
    def _check(self) -> Cylinder:
        refuse_if(_zero_faults("axis", self.axis))
        return self


def _zero_faults(key: str, direction: tuple[float, ...] | None) -> Iterator[Fault]:
    if direction is not None and not any(direction):
        yield Fault((key,), f"must not be the zero vector, as in {show(direction)}")


class Foundation(Section):
    """A rigid body that the deformed body does not enter; exactly one of its shapes."""

    half_space: HalfSpace | None = entry(None, "a half space", optional=True)
    sphere: Sphere | None = entry(None, "a sphere, in 2D a disc", optional=True)
    cylinder: Cylinder | None = entry(None, "a cylinder, in 2D a disc", optional=True)
    force: tuple[TimeScalar, ...] | None = entry(
        None,
        "components of the force that pushes the rigid body against the body: its displacement "
        "along the force is an unknown; null: the rigid body stands still",
        "force, in 2D force/length",
        scalar="t",
        optional=True,
    )

    @model_validator(mode="after")
    def _check(self) -> Foundation:
        given = [name for name in SHAPES if getattr(self, name) is not None]
        if len(given) != 1:
            listed = ", ".join(SHAPES)
            message = f"give exactly one of {listed}, not {' and '.join(given) or 'none'}"
            refuse_if([Fault((), message)])
        if self.force is not None and not any(self.force):
            message = "is zero, so that nothing pushes the foundation; leave it out for a fixed one"
            refuse_if([Fault(("force",), message)])
        return self

    @property
    def shape(self) -> tuple[str, Section]:
        """The name of the shape, and its section."""
        return next((name, getattr(self, name)) for name in SHAPES if getattr(self, name))

    def dimension_faults(self, dim: int) -> Iterator[Fault]:
        """The vectors that do not have ``dim`` components, and an axis in 2D."""
        yield from vector_faults(("force",), self.force, dim)
        if self.half_space is not None:
            yield from vector_faults(("half_space", "point"), self.half_space.point, dim)
            yield from vector_faults(("half_space", "normal"), self.half_space.normal, dim)
        if self.sphere is not None:
            yield from vector_faults(("sphere", "centre"), self.sphere.centre, dim)
        if self.cylinder is not None:
            yield from vector_faults(("cylinder", "centre"), self.cylinder.centre, dim)
            if dim == 3:
                yield from vector_faults(("cylinder", "axis"), self.cylinder.axis, dim)
            elif self.cylinder.axis is not None:
                yield Fault(("cylinder", "axis"), "must be left out in 2D")


#: The keys of a foundation that describe a shape.
SHAPES = tuple(name for name in Foundation.model_fields if name != "force")
