"""Contact and friction: for the whole of Gamma_C, or in a list with a section for each part."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, Tag

from contact_locking.values.concept import Concept, Fault, entry
from contact_locking.values.kinds import (
    LIST,
    SECTION,
    Names,
    NonNegative,
    NonNegativeSlipScalar,
    Positive,
    Text,
    TimedScalar,
    list_or,
)
from contact_locking.values.value import Value

from .rigid_body import Foundation

Kernel = Literal["convolution", "helmholtz", "none"]
Pair = Literal["once", "each_step"]


class Smoothing(Concept):
    """R, the mollifier of the normal stress along Gamma_C."""

    kernel: Kernel = entry(
        "convolution", "convolution, helmholtz (I - r^2 Laplace_Gamma), or none: local Coulomb"
    )
    radius: Positive | None = entry(
        None,
        "r, of the kernel, measured along Gamma_C; null: a tenth of the extent of Gamma_C, two "
        "facets at least",
        "length",
    )


class FrictionParameters(Concept):
    """Coulomb's law (6): |sigma_tau| <= mu(|u_tau|) |R sigma_nu|."""

    coefficient: NonNegativeSlipScalar = entry(
        Value.of(0.0),
        "mu >= 0, a number or an expression of x, y, z and s = |u_tau|",
        "1",
    )
    smoothing: Smoothing = entry(Smoothing(), "the mollifier R")
    regularisation: NonNegative | None = entry(
        None,
        "the slip at which friction reaches 71 % of its bound, eps of (22); 0: Coulomb's law "
        "itself, without regularisation; null: penalty.epsilon times Young's modulus",
        "length",
    )


class OwnSmoothing(Concept):
    """The mollifier R of one part of Gamma_C, as far as it differs from ``friction.smoothing``."""

    kernel: Kernel | None = entry(None, "null: friction.smoothing.kernel")
    radius: Positive | None = entry(None, "null: friction.smoothing.radius", "length")


class OwnFriction(Concept):
    """The friction of one part of Gamma_C, as far as it differs from ``friction``."""

    coefficient: NonNegativeSlipScalar | None = entry(None, "null: friction.coefficient", "1")
    smoothing: OwnSmoothing | None = entry(None, "the mollifier R of this part")
    regularisation: NonNegative | None = entry(None, "null: friction.regularisation", "length")

    def over(self, common: FrictionParameters) -> FrictionParameters:
        """``common``, with the keys that this part gives itself in place of the common ones."""
        own = {name: value for name, value in self if value is not None}
        changed = {name: value for name, value in self.smoothing or () if value is not None}
        smoothing = common.smoothing.model_copy(update=changed)
        return common.model_copy(update={**own, "smoothing": smoothing})


# Each section adds integrals to the forms, and compiling long forms takes long.
_MOST_ENTRIES = 100


class ContactSection(Concept):
    """Signorini's conditions (5) on Gamma_C: u_nu <= gap, or a rigid foundation."""

    on: Names = entry(("bottom",), "name(s) of the parts of Gamma_C; []: no contact")
    against: Names | None = entry(
        None,
        "name(s) of the parts of another body, or of the other side of a cut, that on touches; "
        "those of on: bodies touch each other; null: a foundation",
    )
    pair: Pair | None = entry(
        None,
        "with against: find the points that face each other, and the normals, at the solution of "
        "each_step, or once, on the undeformed mesh; null: each_step",
    )
    gap: TimedScalar = entry(
        Value.of(0.0),
        "distance to the foundation along nu; with against: beyond the distance in the mesh",
        "length",
    )
    foundation: Foundation | None = entry(None, "a rigid body, in place of gap")
    friction: OwnFriction | None = entry(
        None, "friction on this part; what it leaves out is as under friction"
    )
    name: Text | None = entry(
        None,
        "the name of the contact in results, as in contact_force_NAME_x of history.csv; null: the "
        "first of on",
    )

    def _faults(self) -> Iterator[Fault]:
        if self.name is not None and (not self.name.strip() or "." in self.name):
            message = "must be a word without dots, as it is a part of keys such as contacts.NAME"
            yield Fault(("name",), message)
        if self.foundation is not None and self.gap != 0:
            message = "the foundation defines the gap; give either gap or foundation"
            yield Fault(("gap",), message)
        if self.against is None:
            if self.pair is not None:
                message = "is about two bodies; name the other one in against, or leave out pair"
                yield Fault(("pair",), message)
            return
        if not self.against:
            yield Fault(("against",), "needs the name of a boundary part; leave it out without one")
        if self.foundation is not None:
            message = "a contact is with a foundation or with another body; leave out one of both"
            yield Fault(("against",), message)
        both = [name for name in self.against if name in self.on]
        if both and set(self.on) != set(self.against):
            yield Fault(
                ("against",),
                f"'{both[0]}' is in on as well; bodies that touch each other share all names",
            )

    def resolved(self, key: str, common: FrictionParameters) -> ContactParameters:
        """The section at ``key`` of the file, with its friction completed by ``common``."""
        own = self.friction or OwnFriction()
        friction, against, pair = own.over(common), self.against or (), self.pair or "each_step"
        return ContactParameters(
            key, self.on, self.gap, self.foundation, friction, own, against, pair, self.name or ""
        )


@dataclass(frozen=True)
class ContactParameters:
    """One part of Gamma_C with its gap or foundation and its complete law of friction.

    ``key`` is that of its section in the study file: ``contact``, or ``contact.1`` in a list.
    ``own`` holds the keys of friction that the section gives itself.  ``against`` are the parts of
    another body that it touches, empty for a foundation; ``pair`` says when they are paired.
    ``name`` is empty where the section gives none.
    """

    key: str
    on: tuple[str, ...]
    gap: Value
    foundation: Foundation | None
    friction: FrictionParameters
    own: OwnFriction
    against: tuple[str, ...] = ()
    pair: Pair = "once"
    name: str = ""

    def friction_key(self, name: str) -> str:
        """Where the study file defines a value of the friction, such as ``smoothing.radius``.

        The key is ``contact.1.friction.smoothing.radius`` if the section gives the value itself,
        and ``friction.smoothing.radius`` if not.
        """
        given: Any = self.own
        for part in name.split("."):
            given = getattr(given, part, None)
        return f"friction.{name}" if given is None else f"{self.key}.friction.{name}"


_Several = Annotated[tuple[ContactSection, ...], Field(max_length=_MOST_ENTRIES), Tag(LIST)]
OneOrSeveral = Annotated[Annotated[ContactSection, Tag(SECTION)] | _Several, list_or(SECTION)]
