"""Unilateral contact: one section for Gamma_C, or a list with a section for each part."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag, model_validator

from .base import Fault, Section, entry, refuse_if
from .coulomb import FrictionParameters, OwnFriction
from .rigid_body import Foundation
from .values import LIST, SECTION, Names, TimedScalar

# Each section adds integrals to the forms, and compiling long forms takes long.
_MOST_ENTRIES = 100


class ContactSection(Section):
    """Signorini's conditions (5) on Gamma_C: u_nu <= gap, or a rigid foundation."""

    on: Names = entry(("bottom",), "name(s) of the parts of Gamma_C; []: no contact")
    gap: TimedScalar = entry(0.0, "distance to the foundation along nu", "length", scalar="t")
    foundation: Foundation | None = entry(None, "a rigid body, in place of gap", optional=True)
    friction: OwnFriction | None = entry(
        None, "friction on this part; what it leaves out is as under friction", optional=True
    )

    @model_validator(mode="after")
    def _check(self) -> ContactSection:
        if self.foundation is not None and self.gap != 0:
            message = "the foundation defines the gap; give either gap or foundation"
            refuse_if([Fault(("gap",), message)])
        return self

    def dimension_faults(self, dim: int) -> Iterator[Fault]:
        """The faults of the foundation in ``dim`` dimensions."""
        if self.foundation is not None:
            for fault in self.foundation.dimension_faults(dim):
                yield Fault(("foundation", *fault.place), fault.message)

    def resolved(self, key: str, common: FrictionParameters) -> ContactParameters:
        """The section at ``key`` of the file, with its friction completed by ``common``."""
        own = OwnFriction() if self.friction is None else self.friction
        return ContactParameters(key, self.on, self.gap, self.foundation, own.over(common), own)


@dataclass(frozen=True)
class ContactParameters:
    """One part of Gamma_C with its gap or foundation and its complete law of friction.

    ``key`` is that of its section in the study file: ``contact``, or ``contact.1`` in a list.
    ``own`` holds the keys of friction that the section gives itself.
    """

    key: str
    on: tuple[str, ...]
    gap: float | str
    foundation: Foundation | None
    friction: FrictionParameters
    own: OwnFriction

    def friction_key(self, name: str) -> str:
        """Where the study file defines a value of the friction, such as ``smoothing.radius``.

        The key is ``contact.1.friction.smoothing.radius`` if the section gives the value itself,
        and ``friction.smoothing.radius`` if not.
        """
        given: Any = self.own
        for part in name.split("."):
            given = getattr(given, part, None)
        return f"friction.{name}" if given is None else f"{self.key}.friction.{name}"


def _kind(value: Any) -> str:
    return LIST if isinstance(value, list | tuple) else SECTION


_Several = Annotated[tuple[ContactSection, ...], Field(max_length=_MOST_ENTRIES), Tag(LIST)]
OneOrSeveral = Annotated[Annotated[ContactSection, Tag(SECTION)] | _Several, Discriminator(_kind)]
