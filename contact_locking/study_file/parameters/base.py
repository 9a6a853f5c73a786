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

    def _faults_in(self, dim: int) -> Iterator[Fault]:
        """The faults in ``dim`` dimensions but for the vectors, which `dimension_faults` checks."""
        return iter(())


def entry(default: Any, description: str, unit: str = "", **more: Any) -> Any:
    """A key with its default (``...`` for a required key), description and unit.

    Of ``more``, ``alias`` goes to pydantic. The rest is kept with the unit: ``scalar`` marks
    expressions, and ``optional`` the keys that a dump leaves out if they are null. ``vector`` and
    ``vectors`` mark one or several vectors with as many components as the body has dimensions, or
    as the mark says.
    """
    alias = more.pop("alias", None)
    extra = {"unit": unit, **more}
    return Field(default, description=description, alias=alias, json_schema_extra=extra)


def marks(field: FieldInfo) -> dict[str, Any]:
    """The unit and the marks that `entry` keeps with a key."""
    return dict(field.json_schema_extra) if isinstance(field.json_schema_extra, dict) else {}


def leaves(value: Any, place: Place) -> Iterator[tuple[Place, Any]]:
    """The values in nested lists and mappings, with their places."""
    if isinstance(value, tuple | dict):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for key, item in items:
            yield from leaves(item, (*place, key))
    else:
        yield place, value


def sections(section: Section, place: Place = ()) -> Iterator[tuple[Place, Section]]:
    """A section and all sections below it, with their places."""
    yield place, section
    for name, field in type(section).model_fields.items():
        for inner, value in leaves(getattr(section, name), (*place, field.alias or name)):
            if isinstance(value, Section):
                yield from sections(value, inner)


def dimension_faults(whole: Section, dim: int) -> Iterator[Fault]:
    """The values below a section that do not fit a body of ``dim`` dimensions."""
    for place, section in sections(whole):
        for name, field in type(section).model_fields.items():
            given, value = marks(field), getattr(section, name)
            mark = given.get("vector") or given.get("vectors")
            if mark is None or not isinstance(value, tuple):
                continue
            here, size = (*place, field.alias or name), dim if mark is True else mark
            vectors = [((*here, index), one) for index, one in enumerate(value)]
            if "vector" in given:
                vectors = [(here, value)]
            for at, vector in vectors:
                if len(vector) != size:
                    told = f"must have {size} components in {size}D, not {len(vector)}"
                    yield Fault(at, f"{told}: {show(vector)}")
        yield from below(place, section._faults_in(dim))
