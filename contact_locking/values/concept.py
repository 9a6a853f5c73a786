"""The base class of all concepts, and the faults that concepts find."""

from __future__ import annotations

import itertools
from abc import ABCMeta
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    NamedTuple,
    Self,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, model_validator
from pydantic.config import JsonDict
from pydantic.fields import FieldInfo

from contact_locking.errors import InputError

from .value import Value, show, value_message

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
    if first := tuple(itertools.islice(faults, MOST_FAULTS)):
        raise FaultsError(first)


#: Tags of the choices that a value has. Pydantic adds them to the place of an error.
CHOICES = SECTION, LIST, TEXT, ONLY = "<section>", "<list>", "<text>", "<only>"


def faults_of(
    error: ValidationError, message_of: Callable[[Any, Place], str | None] = lambda *_: None
) -> list[Fault]:
    """The faults with their places; at most some 20 of them.

    ``message_of`` makes a message of the details of an error and its place, None for the usual one.
    """
    faults: list[Fault] = []
    for details in itertools.islice(error.errors(include_url=False), MOST_FAULTS):
        # Tags of kinds.OneOf begin so.
        parts = [name for name in details["loc"] if not str(name).startswith("<one ")]
        place = tuple(name for name in parts if name not in CHOICES)
        cause = details.get("ctx", {}).get("error")
        if isinstance(cause, FaultsError):
            faults += [Fault((*place, *fault.place), fault.message) for fault in cause.faults]
        else:
            faults.append(Fault(place, message_of(details, place) or value_message(details)))
    return faults


def below(place: Place, faults: Iterable[Fault]) -> Iterator[Fault]:
    """The faults of a section that is at ``place`` of another one."""
    return (Fault((*place, *fault.place), fault.message) for fault in faults)


@dataclass(frozen=True)
class BodyKind:
    """The body as far as the sizes of tensors depend on it; ``str`` tells it in words."""

    dim: int
    axisymmetric: bool = False
    plane_stress: bool = False

    def __str__(self) -> str:
        return "for an axisymmetric body" if self.axisymmetric else f"in {self.dim}D"

    @property
    def strains(self) -> int:
        """The number of normal strains."""
        return 3 if self.axisymmetric else self.dim

    @property
    def components(self) -> int:
        """The number of components of Mandel vectors."""
        return 4 if self.axisymmetric else self.dim * (self.dim + 1) // 2


def dotted(*place: str | int) -> str:
    """The key of a place in the file."""
    return ".".join(map(str, place))


if TYPE_CHECKING:

    class _Model(metaclass=ABCMeta):
        """BaseModel, whose constructors take what the types of the fields are made of."""

        model_fields: ClassVar[dict[str, FieldInfo]]
        model_fields_set: set[str]

        def __init__(self, *values: Any, **named: Any) -> None: ...  # noqa: B027
        def model_copy(self, *, update: Mapping[str, Any] | None = None) -> Self: ...  # noqa: B027
        def model_dump(self, **options: Any) -> dict[str, Any]: ...  # noqa: B027
        @classmethod
        def model_validate(cls, data: Any, **options: Any) -> Self:
            raise NotImplementedError

        @classmethod
        def model_json_schema(cls, **options: Any) -> dict[str, Any]:
            raise NotImplementedError

else:
    _Model = BaseModel


class Concept(_Model):
    """One concept of a contact problem, for scripts and study files alike.

    A script makes it by its fields, in order or by name.  In a study file it is a mapping: unknown
    keys are refused, and an empty mapping has the defaults.  The constructor raises InputError for
    values that cannot be used.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, defer_build=True, arbitrary_types_allowed=True
    )

    def __init__(self, *values: Any, **named: Any) -> None:
        fields = type(self).model_fields
        # Its key in messages comes by name alone.
        in_order = [name for name in fields if name != "at"]
        if len(values) > len(in_order):
            raise InputError(f"takes {len(in_order)} values at most", type(self).__name__)
        named |= dict(zip(in_order, values, strict=False))
        try:
            # Pydantic knows a field by its key in a study file.
            super().__init__(
                **{
                    self.key_of(name) if name in fields else name: value
                    for name, value in named.items()
                }
            )
        except ValidationError as error:
            fault = faults_of(error)[0]
            key = dotted(type(self).__name__, *fault.place).replace("<", "").replace(">", "")
            raise InputError(fault.message, key) from None

    # Pydantic reads mappings of a study file without this constructor.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def key_of(cls, name: str) -> str:
        """The key of a field in the file."""
        return cls.model_fields[name].alias or name

    @model_validator(mode="before")
    @classmethod
    def _prepare(cls, data: Any, info: ValidationInfo) -> Any:
        data = {} if data is None else data
        if not isinstance(data, dict):
            return data
        if info.context is not None:  # a study file is read
            hidden_keys = {field.alias for field in cls.model_fields.values() if field.exclude}
            refuse_if(Fault((key,), "unknown key") for key in data if key in hidden_keys)
        return cls._completed(data)

    @classmethod
    def _completed(cls, data: dict[str, Any]) -> dict[str, Any]:
        """The mapping of a concept, with what follows from its keys."""
        return data

    @model_validator(mode="after")
    def _check(self) -> Self:
        refuse_if(self._faults())
        return self

    def stated(self) -> dict[str, Any]:
        """The fields that are not None."""
        fields = ((name, getattr(self, name)) for name in type(self).model_fields)
        return {name: value for name, value in fields if value is not None}

    def _faults(self) -> Iterator[Fault]:
        """The faults of the values of the section together."""
        return iter(())

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        """The values that do not fit a body but for vectors, which `dimension_faults` checks."""
        return iter(())


def entry(default: Any, description: str, unit: str = "", **options: Any) -> Any:
    """A key with its default (``...`` for a required key), description and unit.

    ``options`` go to pydantic.
    """
    extra: JsonDict = {"unit": unit}
    if isinstance(default, Value):
        extra["default"] = default.data
    return Field(default, description=description, json_schema_extra=extra, **options)


def hidden(name: str) -> Any:
    """A field of scripts, None by default, that no study file can name."""
    return Field(None, alias=f"<{name}>", exclude=True)


def unit_of(field: FieldInfo) -> str:
    """The unit that `entry` keeps with a key."""
    extra = field.json_schema_extra
    return str(extra["unit"]) if isinstance(extra, dict) else ""


class Components(NamedTuple):
    """Marks the type of vectors with so many components; 0: as many as the body has dimensions."""

    number: int = 0


PER_AXIS = Components()
_Mark = TypeVar("_Mark")


@cache
def marked(model: type[Any], kind: type[_Mark]) -> dict[str, tuple[int, _Mark]]:
    """The fields whose type has a mark of a kind, with the number of lists around it."""
    hints = get_type_hints(model, include_extras=True)
    marks = {name: next(_marks(hints[name], kind), None) for name in model.model_fields}
    return {name: mark for name, mark in marks.items() if mark is not None}


def _marks(annotation: Any, kind: type[_Mark], depth: int = 0) -> Iterator[tuple[int, _Mark]]:
    for metadata in reversed(getattr(annotation, "__metadata__", ())):
        # A mark may be the function of a validator.
        mark = getattr(metadata, "func", metadata)
        if isinstance(mark, kind):
            yield depth, mark
    inside = depth + (get_origin(annotation) is tuple)
    for argument in get_args(annotation):
        yield from _marks(argument, kind, inside)


def leaves(value: Any, place: Place) -> Iterator[tuple[Place, Any]]:
    """The values in nested lists and mappings, with their places."""
    if isinstance(value, tuple | dict):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for key, inner in items:
            yield from leaves(inner, (*place, key))
    else:
        yield place, value


def place_of(place: Place, section: Concept, name: str) -> Place:
    """The place of a field; what a concept is made of alone has the place of the concept."""
    key = section.key_of(name)
    return place if key in CHOICES else (*place, key.strip("<>"))


def sections(section: Concept, place: Place = ()) -> Iterator[tuple[Place, Concept]]:
    """A section and all sections below it, with their places."""
    yield place, section
    for name in type(section).model_fields:
        for inner, value in leaves(getattr(section, name), place_of(place, section, name)):
            if isinstance(value, Concept):
                yield from sections(value, inner)


def require_fitting(whole: Any, body: BodyKind, key: str) -> None:
    """Raise InputError for a concept with a value that does not fit a body."""
    for fault in dimension_faults(whole, body) if isinstance(whole, Concept) else ():
        raise InputError(fault.message, dotted(key, *fault.place))


def dimension_faults(whole: Concept, body: BodyKind) -> Iterator[Fault]:
    """The values below a section that do not fit a body."""
    for place, section in sections(whole):
        for name, (depth, components) in marked(type(section), Components).items():
            value, path = getattr(section, name), place_of(place, section, name)
            if not isinstance(value, tuple):
                continue
            size = components.number or body.dim
            vectors = [((*path, index), row) for index, row in enumerate(value)]
            for at, vector in vectors if depth else [(path, value)]:
                if len(vector) != size:
                    message = f"must have {size} components in {size}D, not {len(vector)}"
                    yield Fault(at, f"{message}: {show(vector)}")
        yield from below(place, section._faults_in(body))
