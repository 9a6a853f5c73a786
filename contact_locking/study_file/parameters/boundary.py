"""The loads and supports, and the tables of numbers for expressions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from keyword import iskeyword
from typing import Annotated, Any

from pydantic import Field

from contact_locking.expressions import CONSTANTS, FUNCTIONS, POSITION, TIME
from contact_locking.supports.support import (
    BodyForce,
    Displacement,
    Load,
    Pressure,
    Spring,
    Support,
    TotalForce,
    Traction,
)
from contact_locking.values.concept import Concept, Fault, dotted, entry, leaves, place_of
from contact_locking.values.kinds import TimedVector
from contact_locking.values.value import Value

# All tractions, pressures and forces are compiled into one form, which takes seconds for 200 of
# them and fails for some 2000.
_MOST_TRACTIONS = 200


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

    def of(self, *kinds: str) -> list[Any]:
        """The entries of some kinds, each with its key."""
        return [
            item.model_copy(update={"at": dotted("loads", kind, number)})
            for kind in kinds
            for number, item in enumerate(getattr(self, kind))
        ]

    @property
    def acting(self) -> list[Load]:
        """The loads, each with its key."""
        force = self.body_force
        whole = [] if force is None else [BodyForce(force, at="loads.body_force")]
        return [*whole, *self.of("forces", "tractions", "pressures")]

    @property
    def held(self) -> list[Support | Displacement]:
        """The prescribed displacements, each with its key."""
        return self.of("supports", "displacements")

    def numbers(self) -> Iterator[tuple[str, Value]]:
        """The key and the number or expression of each component that loads the body."""
        for item in (*self.acting, *self.held):
            for place, value in leaves(item.value, place_of((), item, "value")):
                if value is not None:
                    yield dotted(item.key, *place), value


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
