"""The loads and supports: body force, tractions, pressures and prescribed displacements."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field, model_validator

from .base import Fault, Place, Section, entry, refuse_if, vector_faults
from .values import Along, Names, TimedScalar

# All tractions and pressures are compiled into one form, which takes seconds for 200 of them and
# fails for some 2000.
_MOST_TRACTIONS = 200


class Traction(Section):
    """sigma nu = g on a part of the boundary."""

    on: Names = entry(..., "name(s) of parts of the boundary")
    value: tuple[TimedScalar, ...] = entry(..., "components of g", "stress", scalar="t")


class Pressure(Section):
    """sigma nu = -p nu on a part of the boundary, with the outward normal nu of the mesh."""

    on: Names = entry(..., "name(s) of parts of the boundary")
    value: TimedScalar = entry(
        ...,
        "pressure p along the normal: a positive p pushes on the body, a negative p pulls",
        "stress",
        scalar="t",
    )


class Displacement(Section):
    """u = value on a part of the boundary; a null component stays free."""

    on: Names = entry(..., "name(s) of parts of the boundary")
    value: tuple[TimedScalar | None, ...] = entry(
        ..., "components of u; null leaves one free", "length", scalar="t"
    )

    @model_validator(mode="after")
    def _check(self) -> Displacement:
        if all(component is None for component in self.value):
            refuse_if([Fault(("value",), "fixes no component; give a number for at least one")])
        return self


class Support(Section):
    """u . m = value on a part of the boundary, which slides freely across m: an oblique roller."""

    on: Names = entry(..., "name(s) of parts of the boundary")
    along: Along = entry(
        ...,
        "the direction m: normal (the outward normal of the mesh), or a vector of any length",
    )
    value: TimedScalar = entry(0.0, "the displacement along m", "length", scalar="t")


class LoadParameters(Section):
    """Body force f0, tractions g, pressures, prescribed displacements and supports, (2)-(4)."""

    body_force: tuple[TimedScalar, ...] | None = entry(
        None, "components of f0; null: none", "force/volume", scalar="t"
    )
    tractions: Annotated[tuple[Traction, ...], Field(max_length=_MOST_TRACTIONS)] = entry(
        (), "parts of Gamma_N with their g"
    )
    pressures: Annotated[tuple[Pressure, ...], Field(max_length=_MOST_TRACTIONS)] = entry(
        (), "parts of Gamma_N with their pressure; several loads on one part add up"
    )
    displacements: tuple[Displacement, ...] = entry((), "parts of Gamma_D with their u")
    supports: tuple[Support, ...] = entry(
        (), "parts of Gamma_D that are held along their normal or along a given direction"
    )

    @model_validator(mode="after")
    def _check(self) -> LoadParameters:
        refuse_if(self._prescribed_twice())
        count = len(self.tractions) + len(self.pressures)
        if count > _MOST_TRACTIONS:
            message = f"{count} entries together with tractions; at most {_MOST_TRACTIONS}"
            refuse_if([Fault(("pressures",), message)])
        return self

    def held(self) -> Iterator[tuple[Place, Displacement | Support]]:
        """The entries with prescribed displacements, with their places."""
        for index, displacement in enumerate(self.displacements):
            yield ("displacements", index), displacement
        for index, support in enumerate(self.supports):
            yield ("supports", index), support

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
        """The vectors that do not have ``dim`` components."""
        yield from vector_faults(("body_force",), self.body_force, dim)
        for index, traction in enumerate(self.tractions):
            yield from vector_faults(("tractions", index, "value"), traction.value, dim)
        for index, displacement in enumerate(self.displacements):
            yield from vector_faults(("displacements", index, "value"), displacement.value, dim)
        for index, support in enumerate(self.supports):
            if support.along != "normal":
                yield from vector_faults(("supports", index, "along"), support.along, dim)
