"""The motion of a tool that the study file prescribes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import Discriminator, Tag, model_validator

from .base import Fault, Section, entry, refuse_if, vector_faults
from .values import LIST, SECTION, Number, TimeScalar

Translation = tuple[TimeScalar, ...]


def _list_or_value(value: Any) -> str:
    return LIST if isinstance(value, list | tuple) else SECTION


Rotation = Annotated[
    Annotated[tuple[TimeScalar, ...], Tag(LIST)] | Annotated[TimeScalar, Tag(SECTION)],
    Discriminator(_list_or_value),
]


class Motion(Section):
    """x = about + R (X - about) + translation, from rest: without motion x = X."""

    translation: Translation | None = entry(
        None, "components of the displacement; null: none", "length", scalar="t", optional=True
    )
    rotation: Rotation | None = entry(
        None, "angle, in 3D the components of a rotation vector; null: none", "rad",
        scalar="t", optional=True,
    )  # fmt: skip
    about: tuple[Number, ...] | None = entry(
        None, "the point of the tool at rest about which the tool turns", "length", optional=True
    )

    @model_validator(mode="after")
    def _check(self) -> Motion:
        refuse_if(self._faults())
        return self

    def _faults(self) -> Iterator[Fault]:
        if self.translation is None and self.rotation is None:
            yield Fault((), "moves nothing: give translation, rotation or both")
        if (self.rotation is None) != (self.about is None):
            missing, there = ("about", "rotation") if self.about is None else ("rotation", "about")
            yield Fault((missing,), f"is missing beside {there}")

    def dimension_faults(self, dim: int) -> Iterator[Fault]:
        """The vectors that do not have ``dim`` components, and an angle of another kind."""
        yield from vector_faults(("translation",), self.translation, dim)
        yield from vector_faults(("about",), self.about, dim)
        if dim == 2 and isinstance(self.rotation, tuple):
            yield Fault(("rotation",), "is one angle in 2D, and no list")
        if dim == 3 and self.rotation is not None:
            if isinstance(self.rotation, tuple):
                yield from vector_faults(("rotation",), self.rotation, dim)
            else:
                message = "is a vector with 3 components in 3D: the axis times the angle"
                yield Fault(("rotation",), message)

    @property
    def angles(self) -> tuple[float | str, ...] | None:
        """The components of the rotation, one in 2D and three in 3D."""
        if self.rotation is None or isinstance(self.rotation, tuple):
            return self.rotation
        return (self.rotation,)


MotionOrTranslation = Annotated[
    Annotated[Motion, Tag(SECTION)] | Annotated[Translation, Tag(LIST)],
    Discriminator(_list_or_value),
]
