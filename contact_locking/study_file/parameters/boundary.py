"""The loads and supports, and the tables of numbers for expressions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from keyword import iskeyword
from typing import Annotated

from pydantic import Field

from contact_locking.expressions import CONSTANTS, FUNCTIONS, POSITION, TIME
from contact_locking.supports.support import Support
from contact_locking.values.concept import PER_AXIS, Concept, Fault, Place, entry
from contact_locking.values.kinds import (
    Along,
    Names,
    PositiveScalar,
    TimedScalar,
    TimedVector,
    TimeVector,
)
from contact_locking.values.value import Value

# All tractions and pressures are compiled into one form, which takes seconds for 200 of them and
# fails for some 2000.
_MOST_TRACTIONS = 200


class Traction(Concept):
    """sigma nu = g on a part of the boundary."""

    on: Names = entry(..., "name(s) of parts of the boundary")
    value: TimedVector = entry(..., "components of g", "stress")


class Pressure(Concept):
    """sigma nu = -p nu on a part of the boundary, with the outward normal nu of the mesh."""

    on: Names = entry(..., "name(s) of parts of the boundary")
    value: TimedScalar = entry(
        ...,
        "pressure p along the normal: a positive p pushes on the body, a negative p pulls",
        "stress",
    )


class TotalForce(Concept):
    """int sigma nu = F on a part of the boundary, spread evenly: sigma nu = F / |part|."""

    on: Names = entry(..., "name(s) of parts of the boundary, which share the force by their sizes")
    value: TimeVector = entry(..., "components of F; in 2D for a unit of thickness", "force")


class Displacement(Concept):
    """u = value on a part of the boundary; a null component stays free."""

    on: Names = entry(..., "name(s) of parts of the boundary")
    value: Annotated[tuple[TimedScalar | None, ...], PER_AXIS] = entry(
        ..., "components of u; null leaves one free", "length"
    )

    def _faults(self) -> Iterator[Fault]:
        if all(component is None for component in self.value):
            yield Fault(("value",), "fixes no component; give a number for at least one")


class Spring(Concept):
    """sigma nu = -k (u . m) m on a part of the boundary: an elastic foundation, or a spring bed."""

    on: Names = entry(..., "name(s) of parts of the boundary")
    stiffness: PositiveScalar = entry(..., "k > 0", "stress/length")
    along: Along | None = entry(
        None, "the direction m: normal, or a vector of any length; null: springs in all directions"
    )


class LoadParameters(Concept):
    """Body force f0, tractions g, pressures, prescribed displacements and supports, (2)-(4)."""

    body_force: TimedVector | None = entry(None, "components of f0; null: none", "force/volume")
    tractions: Annotated[tuple[Traction, ...], Field(max_length=_MOST_TRACTIONS)] = entry(
        (), "parts of Gamma_N with their g"
    )
    pressures: Annotated[tuple[Pressure, ...], Field(max_length=_MOST_TRACTIONS)] = entry(
        (), "parts of Gamma_N with their pressure; several loads on one part add up"
    )
    forces: Annotated[tuple[TotalForce, ...], Field(max_length=_MOST_TRACTIONS)] = entry(
        (), "parts of Gamma_N with the total of their tractions, which are spread evenly"
    )
    displacements: tuple[Displacement, ...] = entry((), "parts of Gamma_D with their u")
    supports: tuple[Support, ...] = entry(
        (), "parts of Gamma_D that are held along their normal or along a given direction"
    )

    springs: Annotated[tuple[Spring, ...], Field(max_length=_MOST_TRACTIONS)] = entry(
        (), "parts of the boundary on springs, which hold the body"
    )

    def _faults(self) -> Iterator[Fault]:
        yield from self._prescribed_twice()
        count = len(self.tractions) + len(self.pressures) + len(self.forces)
        if count > _MOST_TRACTIONS:
            kind = "pressures" if self.pressures else "forces"
            message = f"{count} tractions, pressures and forces in all; at most {_MOST_TRACTIONS}"
            yield Fault((kind,), message)

    def held(self) -> Iterator[tuple[Place, Displacement | Support]]:
        """The entries with prescribed displacements, with their places."""
        for index, displacement in enumerate(self.displacements):
            yield ("displacements", index), displacement
        for index, support in enumerate(self.supports):
            yield ("supports", index), support

    def numbers(self) -> Iterator[tuple[Place, Value]]:
        """The number or expression of each component that loads the body, with its place."""
        for axis, force in enumerate(self.body_force or ()):
            yield ("body_force", axis), force
        for index, pressure in enumerate(self.pressures):
            yield ("pressures", index, "value"), pressure.value
        for index, support in enumerate(self.supports):
            yield ("supports", index, "value"), support.value
        vectors: dict[str, tuple[Traction | TotalForce | Displacement, ...]] = {
            "tractions": self.tractions,
            "forces": self.forces,
            "displacements": self.displacements,
        }
        for name, items in vectors.items():
            for index, item in enumerate(items):
                for axis, component in enumerate(item.value):
                    if component is not None:
                        yield (name, index, "value", axis), component

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


#: Names that a table may not have.
_TAKEN = {*POSITION, TIME, "s", "inf", *CONSTANTS, *FUNCTIONS}
_MOST_TABLES = 50


def name_faults(names: Iterable[str], what: str) -> Iterator[Fault]:
    """The names of tables or numbers, in words ``what``, that expressions cannot use."""
    names = list(names)
    if len(names) > _MOST_TABLES:
        yield Fault((), f"has {len(names)} {what}; at most {_MOST_TABLES} are allowed")
    for name in names:
        if not (name.isascii() and name.isidentifier()) or iskeyword(name):
            yield Fault((name,), "is no name for expressions; take letters, digits and _")
        elif name in _TAKEN:
            yield Fault((name,), "is a name that expressions have already; take another")
