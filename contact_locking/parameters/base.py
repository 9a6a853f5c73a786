"""What the sections of a study file are made of: their base class and the types of their values."""

from __future__ import annotations

import itertools
import math
import unicodedata
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated, Any, NamedTuple

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    WithJsonSchema,
    model_validator,
)
from pydantic.fields import FieldInfo

from contact_locking.errors import InputError
from contact_locking.expressions import POSITION, SMALLEST, nearest, parse

Place = tuple[str | int, ...]

#: Tags of the choices that a value has; pydantic puts them into the place of an error.
SECTION, LIST = CHOICES = ("<section>", "<list>")

#: How many faults are worth finding: a file with more is no study file with mistakes.
MOST_FAULTS = 20


class Fault(NamedTuple):
    """One thing that is wrong: where, relative to the section that says so, and what."""

    place: Place
    message: str


class FaultsError(ValueError):
    """What a section finds wrong with its values; each with its own place."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults = tuple(faults)
        super().__init__("; ".join(fault.message for fault in self.faults))


def refuse_if(faults: Iterable[Fault]) -> None:
    """Raise FaultsError if there are any; the first of very many."""
    if found := tuple(itertools.islice(faults, MOST_FAULTS)):
        raise FaultsError(found)


def vector_faults(place: Place, vector: Any, dim: int) -> Iterator[Fault]:
    """Whether a vector that may be None has ``dim`` components."""
    if vector is not None and len(vector) != dim:
        yield Fault(
            place, f"must have {dim} components in {dim}D, not {len(vector)}: {show(vector)}"
        )


class Section(BaseModel):
    """A mapping of the study file. Unknown keys are refused, an empty section has its defaults."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _prepare(cls, data: Any) -> Any:
        return {} if data is None else data


def entry(default: Any, description: str, unit: str = "", **more: Any) -> Any:
    """A key with its default (``...`` if it has to be given), description and unit.

    Of ``more``, ``alias`` goes to pydantic. The rest is kept with the unit: ``scalar`` marks
    expressions, ``optional`` the keys that are left out of a dump where they are null.
    """
    alias = more.pop("alias", None)
    extra = {"unit": unit, **more}
    return Field(default, description=description, alias=alias, json_schema_extra=extra)


def marks(field: FieldInfo) -> dict[str, Any]:
    """What `entry` keeps with a key beside pydantic's own: its unit, and so on."""
    return dict(field.json_schema_extra) if isinstance(field.json_schema_extra, dict) else {}


def show(value: Any) -> str:
    """A value as a message repeats it: in YAML's words and not too long."""
    match value:
        case None:
            return "null"
        case bool():
            return str(value).lower()
        case float() if math.isnan(value):
            return ".nan"
        case float() if math.isinf(value):
            return ".inf" if value > 0 else "-.inf"
        case int() | float():
            huge = isinstance(value, int) and abs(value) >= 10**20
            text = "a huge integer" if huge else str(value).removesuffix(".0")
        case str():
            text = repr(value)
        case list() | tuple():
            text = f"[{', '.join(show(item) for item in value[:10])}{', ...' * (len(value) > 10)}]"
        case dict() if not value:
            text = "{}"
        case dict():
            text = f"a mapping with the keys {', '.join(map(str, list(value)[:10]))}"
        case _:
            text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def type_message(details: Any) -> str:
    """What an error of pydantic about a value's type means, in the words of the study file."""
    given_value = details["input"]
    given = show(given_value)
    if details["type"] == "too_long":
        context = details["ctx"]
        return f"has {len(given_value)} entries; at most {context['max_length']} are allowed"
    if details["type"] in ("list_type", "tuple_type"):
        how = (
            "in [ ], or of entries that begin with '- '"
            if isinstance(given_value, dict)
            else "in [ ]"
        )
        return f"must be a list {how}, not {given}"
    return f"cannot be {given}: {details['msg'][:1].lower()}{details['msg'][1:]}"


def unknown_key(key: str, known: Sequence[str], elsewhere: str = "") -> str:
    """That a key is not known, with what may have been meant, and what is known.

    ``elsewhere`` is a hint at a key of another section.
    """
    name, colon, value = key.partition(":")
    if colon and name in known:
        hint = f" (a blank is missing after the colon: '{name}: {value}')"
    elif key.isdecimal():
        hint = " (numbers take a decimal point, not a comma)"
    else:
        hint = nearest(key, known) or elsewhere
    return f"unknown key{hint}; known here: {', '.join(known)}"


def _number(value: Any, infinite: bool) -> float:
    """The number, also where it is written as a constant expression such as "1/3"."""
    wanted = "must be a number" if infinite else "must be a finite number"
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"{wanted}, not {show(value)}")
    try:
        return float(parse(value, (), allow_infinite=infinite).numpy())
    except InputError as error:
        raise ValueError(f"{wanted}, not {show(value)}{_reason(value, error)}") from None


def _reason(value: Any, error: InputError) -> str:
    """Why a value is refused, in parentheses, where the value itself does not show it."""
    shown = isinstance(value, float) and not math.isfinite(value)
    return "" if shown else f" ({error})"


def _finite(value: Any) -> float:
    return _number(value, infinite=False)


def _extended(value: Any) -> float:
    return _number(value, infinite=True)


def _positive(value: float) -> float:
    if value <= 0:
        raise ValueError(f"must be > 0, not {show(value)}")
    if value < SMALLEST:
        raise ValueError(f"must be at least {SMALLEST:g}, not {show(value)}")
    return value


def _integer(value: Any) -> int:
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f"must be an integer, not {show(value)}")
    return value


def _count(value: int) -> int:
    if not 1 <= value <= 10**9:
        raise ValueError(f"must be an integer from 1 to 10^9, not {show(value)}")
    return value


def _switch(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"must be true or false, not {show(value)}")
    return value


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"must be text (in quotes, if it looks like a number), not {show(value)}")
    if any("\ud800" <= character <= "\udfff" for character in value):
        raise ValueError(f"contains what is no character: {ascii(value)[:60]}")
    if any(
        unicodedata.category(character) == "Cc" for character in value if character not in "\n\t"
    ):
        # They would be written to terminals, which obey them.
        raise ValueError(f"contains a control character: {ascii(value)[:60]}")
    return value


def _names(value: Any) -> tuple[str, ...]:
    names = (value,) if isinstance(value, str) else value
    if not isinstance(names, list | tuple) or not all(isinstance(n, str) and n for n in names):
        raise ValueError(f"must be a name or a list of names, not {show(value)}")
    if twice := [name for name, number in Counter(names).items() if number > 1]:
        raise ValueError(f"names {', '.join(sorted(twice))} more than once")
    return tuple(names)


class _ScalarRule(NamedTuple):
    variables: tuple[str, ...]
    infinite: bool = False

    def __call__(self, value: Any) -> float | str:
        """The number, also where it is written as an expression, or the expression's text."""
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise ValueError(f"must be a number or an expression, not {show(value)}")
        try:
            expression = parse(value, self.variables, allow_infinite=self.infinite)
            return float(expression.numpy()) if expression.is_constant else expression.text
        except InputError as error:
            if isinstance(value, str):
                raise ValueError(str(error)) from None
            raise ValueError(
                f"must be a finite number, not {show(value)}{_reason(value, error)}"
            ) from None


_NAME_SCHEMA = {"type": "string", "minLength": 1}
_NAMES_SCHEMA = {"anyOf": [_NAME_SCHEMA, {"type": "array", "items": _NAME_SCHEMA}]}

Number = Annotated[float, BeforeValidator(_finite)]
Positive = Annotated[float, BeforeValidator(_finite), AfterValidator(_positive)]
PositiveOrInfinite = Annotated[float, BeforeValidator(_extended), AfterValidator(_positive)]
Integer = Annotated[int, BeforeValidator(_integer)]
Count = Annotated[int, BeforeValidator(_integer), AfterValidator(_count)]
Switch = Annotated[bool, BeforeValidator(_switch)]
Text = Annotated[str, BeforeValidator(_text)]
Names = Annotated[tuple[str, ...], BeforeValidator(_names), WithJsonSchema(_NAMES_SCHEMA)]
Scalar = Annotated[float | str, BeforeValidator(_ScalarRule(POSITION))]
ScalarOrInfinite = Annotated[float | str, BeforeValidator(_ScalarRule(POSITION, infinite=True))]
SlipScalar = Annotated[float | str, BeforeValidator(_ScalarRule((*POSITION, "s")))]
