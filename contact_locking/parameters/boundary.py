"""What acts on the body: loads, prescribed displacements, the foundation and friction."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from pydantic import model_validator

from .base import (
    Fault,
    Names,
    Number,
    Place,
    Positive,
    Scalar,
    Section,
    SlipScalar,
    entry,
    refuse_if,
    show,
)

# All are compiled into one form, which takes seconds for these and fails for some 2000.
_MOST_TRACTIONS = 200


def vector_faults(place: Place, vector: Any, dim: int) -> Iterator[Fault]:
    """Whether a vector that may be None has ``dim`` components."""
    if vector is not None and len(vector) != dim:
        yield Fault(
            place, f"must have {dim} components in {dim}D, not {len(vector)}: {show(vector)}"
        )


class Traction(Section):
    """sigma nu = g on a part of the boundary."""

    on: Names = entry(..., "name(s) of parts of the boundary")
    value: tuple[Scalar, ...] = entry(..., "components of g", "stress", scalar=True)


class Displacement(Section):
    """u = value on a part of the boundary; a null component stays free."""

    on: Names = entry(..., "name(s) of parts of the boundary")
    value: tuple[Scalar | None, ...] = entry(
        ..., "components of u; null leaves one free", "length", scalar=True
    )

    @model_validator(mode="after")
    def _check(self) -> Displacement:
        if all(component is None for component in self.value):
            refuse_if([Fault(("value",), "fixes no component; give a number for at least one")])
        return self


class LoadParameters(Section):
    """Body force f0, tractions g and prescribed displacements, (2)-(4)."""

    body_force: tuple[Scalar, ...] | None = entry(
        None, "components of f0; null: none", "force/volume", scalar=True
    )
    tractions: tuple[Traction, ...] = entry((), "parts of Gamma_N with their g")
    displacements: tuple[Displacement, ...] = entry((), "parts of Gamma_D with their u")

    @model_validator(mode="after")
    def _check(self) -> LoadParameters:
        if len(self.tractions) > _MOST_TRACTIONS:
            message = f"has {len(self.tractions)} entries; at most {_MOST_TRACTIONS} are allowed"
            refuse_if([Fault(("tractions",), message)])
        refuse_if(self._prescribed_twice())
        return self

    def _prescribed_twice(self) -> Iterator[Fault]:
        seen: dict[tuple[str, int], int] = {}
        for index, displacement in enumerate(self.displacements):
            for name in displacement.on:
                for axis, component in enumerate(displacement.value):
                    if component is None:
                        continue
                    first = seen.setdefault((name, axis), index)
                    if first != index:
                        yield Fault(
                            ("displacements", index),
                            f"component {axis} on '{name}' is prescribed by entry {first} already",
                        )

    def dimension_faults(self, dim: int) -> Iterator[Fault]:
        """Vectors of a wrong length."""
        yield from vector_faults(("body_force",), self.body_force, dim)
        for index, traction in enumerate(self.tractions):
            yield from vector_faults(("tractions", index, "value"), traction.value, dim)
        for index, displacement in enumerate(self.displacements):
            yield from vector_faults(("displacements", index, "value"), displacement.value, dim)


class HalfSpace(Section):
    """(x - point) . normal <= 0."""

    point: tuple[Number, ...] = entry(..., "a point of its surface", "length")
    normal: tuple[Number, ...] = entry(..., "out of it, towards the body; of any length", "1")

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
    """A rigid body that the deformed body does not enter; exactly one of its keys."""

    half_space: HalfSpace | None = entry(None, "a half space", optional=True)
    sphere: Sphere | None = entry(None, "a sphere, in 2D a disc", optional=True)
    cylinder: Cylinder | None = entry(None, "a cylinder, in 2D a disc", optional=True)

    @model_validator(mode="after")
    def _exactly_one(self) -> Foundation:
        names = list(type(self).model_fields)
        given = [name for name in names if getattr(self, name) is not None]
        if len(given) != 1:
            message = f"give exactly one of {', '.join(names)}, not {' and '.join(given) or 'none'}"
            refuse_if([Fault((), message)])
        return self

    def dimension_faults(self, dim: int) -> Iterator[Fault]:
        """Vectors of a wrong length."""
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


class ContactParameters(Section):
    """Signorini's conditions (5) on Gamma_C: u_nu <= gap, or a rigid foundation."""

    on: Names = entry(("bottom",), "name(s) of the parts of Gamma_C; []: no contact")
    gap: Scalar = entry(0.0, "distance to the foundation along nu", "length", scalar=True)
    foundation: Foundation | None = entry(None, "a rigid body, in place of gap", optional=True)

    @model_validator(mode="after")
    def _check(self) -> ContactParameters:
        if self.foundation is not None and self.gap != 0:
            message = "the foundation defines the gap; give either gap or foundation"
            refuse_if([Fault(("gap",), message)])
        return self

    def dimension_faults(self, dim: int) -> Iterator[Fault]:
        """As of the foundation."""
        if self.foundation is not None:
            for fault in self.foundation.dimension_faults(dim):
                yield Fault(("foundation", *fault.place), fault.message)


class Smoothing(Section):
    """R, the mollifier of the normal stress along Gamma_C."""

    kernel: Literal["convolution", "helmholtz", "none"] = entry(
        "convolution", "convolution, helmholtz (I - r^2 Laplace_Gamma), or none: local Coulomb"
    )
    radius: Positive | None = entry(
        None,
        "r, of the kernel, measured along Gamma_C; null: a tenth of the extent of Gamma_C, two "
        "facets at least",
        "length",
    )


class FrictionParameters(Section):
    """Coulomb's law (6): |sigma_tau| <= mu(|u_tau|) |R sigma_nu|."""

    coefficient: SlipScalar = entry(
        0.0, "mu >= 0, a number or an expression of x, y, z and s = |u_tau|", "1", scalar="s"
    )
    smoothing: Smoothing = entry(Smoothing(), "the mollifier R")
    regularisation: Positive | None = entry(
        None,
        "the slip at which friction reaches 71 % of its bound, eps of (22); null: penalty.epsilon "
        "times Young's modulus",
        "length",
    )

    @model_validator(mode="after")
    def _check(self) -> FrictionParameters:
        if isinstance(self.coefficient, float) and self.coefficient < 0:
            message = f"must be >= 0, not {show(self.coefficient)}"
            refuse_if([Fault(("coefficient",), message)])
        return self
