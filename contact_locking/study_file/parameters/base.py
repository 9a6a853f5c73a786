"""The base class of the sections of a study file, and the faults that sections find."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic.fields import FieldInfo

from .wording import show

Place = tuple[str | int, ...]

#: A file with more faults than these is no study file with mistakes.
MOST_FAULTS = 20


class Fault(NamedTuple):
    """One thing that is wrong, and its place relative to the section that finds it."""

    place: Place
    message: str


class FaultsError(ValueError):
    """The faults that a section finds in its values."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults = tuple(faults)
        super().__init__("; ".join(fault.message for fault in self.faults))


def refuse_if(faults: Iterable[Fault]) -> None:
    """Raise FaultsError if there are faults, with the first `MOST_FAULTS` of them."""
    if found := tuple(itertools.islice(faults, MOST_FAULTS)):
        raise FaultsError(found)


def below(place: Place, faults: Iterable[Fault]) -> Iterator[Fault]:
    """The faults of a section that is at ``place`` of another one."""
    return (Fault((*place, *fault.place), fault.message) for fault in faults)


def vector_faults(place: Place, vector: Any, dim: int) -> Iterator[Fault]:
    """The fault of a vector that has not ``dim`` components; None has no fault."""
    if vector is not None and len(vector) != dim:
        yield Fault(
            place, f"must have {dim} components in {dim}D, not {len(vector)}: {show(vector)}"
        )


def zero_faults(key: str, direction: tuple[float, ...] | None) -> Iterator[Fault]:
    """The fault of a direction that is zero; None has no fault."""
    if direction is not None and not any(direction):
        yield Fault((key,), f"must not be the zero vector, as in {show(direction)}")


class Section(BaseModel):
    """A mapping of the study file. Unknown keys are refused; an empty section has its defaults."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _prepare(cls, data: Any) -> Any:
        return {} if data is None else data

    @model_validator(mode="after")
    def _check(self) -> Self:
        refuse_if(self._faults())
        return self

    def _faults(self) -> Iterator[Fault]:
        """The faults of the values of the section together."""
        return iter(())


def entry(default: Any, description: str, unit: str = "", **more: Any) -> Any:
    """A key with its default (``...`` for a required key), description and unit.

    Of ``more``, ``alias`` goes to pydantic. The rest is kept with the unit: ``scalar`` marks
    expressions, ``optional`` the keys that a dump leaves out if they are null.
    """
    alias = more.pop("alias", None)
    extra = {"unit": unit, **more}
    return Field(default, description=description, alias=alias, json_schema_extra=extra)


def marks(field: FieldInfo) -> dict[str, Any]:
    """The unit and the marks that `entry` keeps with a key."""
    return dict(field.json_schema_extra) if isinstance(field.json_schema_extra, dict) else {}
