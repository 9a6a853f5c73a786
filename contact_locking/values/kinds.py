"""The types of the values in a study file: numbers, expressions, names and text.

The bounds of numbers are pydantic's, so that the JSON schema has them; `wording` has the messages.
"""

from __future__ import annotations

import math
import operator
import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from functools import partial, reduce
from numbers import Real
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    create_model,
)
from pydantic.json_schema import SkipJsonSchema
from pydantic_core import core_schema

from contact_locking.arrays import SMALLEST
from contact_locking.errors import InputError
from contact_locking.expressions import POSITION, TIME, Table, parse
from contact_locking.files import require_file, similar
from contact_locking.values.concept import (
    LIST,
    PER_AXIS,
    SECTION,
    TEXT,
    Concept,
    Place,
    leaves,
    marked,
    place_of,
    sections,
)
from contact_locking.values.value import Tabulated, Value, show

T = TypeVar("T")

_Name = Annotated[str, Field(min_length=1)]


def plain(value: Any) -> Any:
    """A number of NumPy as one of Python, and an array as lists."""
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value


def _number(value: Any, infinite: bool) -> float:
    """The number, also if it is written as a constant expression such as "1/3"."""
    demand = "must be a number" if infinite else "must be a finite number"
    if isinstance(value, bool) or not isinstance(value, Real | str):
        raise ValueError(f"{demand}, not {show(value)}")
    try:
        return float(parse(plain(value), (), allow_infinite=infinite).numpy())
    except InputError as error:
        raise ValueError(f"{demand}, not {show(value)}{_reason(value, error)}") from None


def _reason(value: Any, error: InputError) -> str:
    """Why a value is refused, in parentheses, unless the value itself shows it."""
    shown = isinstance(value, float) and not math.isfinite(value)
    return "" if shown else f" ({error})"


_finite = partial(_number, infinite=False)


def _number_or_infinite(value: Any) -> float:
    return value if value == -math.inf else _number(value, infinite=True)


def _not_tiny(value: float) -> float:
    if 0.0 < abs(value) < SMALLEST:
        raise ValueError(f"must be at least {SMALLEST:g} in size, not {show(value)}")
    return value


def _whole(value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _harmless(text: str) -> str:
    """Refuse lone surrogates, and control characters, which terminals would obey."""
    kinds = {unicodedata.category(letter) for letter in text if letter not in "\n\t"}
    if "Cs" in kinds:
        raise ValueError(f"contains an escape that is no character: {ascii(text)[:60]}")
    if "Cc" in kinds:
        raise ValueError(f"contains a control character: {ascii(text)[:60]}")
    return text


def _there(name: str, info: ValidationInfo) -> str:
    """The absolute path of a file, relative to the folder that is the context, if there is one."""
    if info.context is None:
        return name
    file = Path(info.context).absolute() / name
    try:
        require_file(file, "such file")
    except InputError as error:
        raise ValueError(f"{error}{'' if file.exists() else similar(file)}") from None
    return str(file)


def _names(value: Any) -> tuple[str, ...]:
    names = (value,) if isinstance(value, str) else value
    if not isinstance(names, list | tuple) or not all(isinstance(n, str) and n for n in names):
        raise ValueError(f"must be a name or a list of names, not {show(value)}")
    if twice := [name for name, number in Counter(names).items() if number > 1]:
        raise ValueError(f"names {', '.join(sorted(twice))} more than once")
    return tuple(names)


def _places(value: Any, info: ValidationInfo) -> Any:
    """Names of boundary parts; in a script facets, or mesh tags with a value, as well."""
    if info.context is not None:
        return _names(value)
    if isinstance(value, list | tuple):
        are_names = not value or any(isinstance(x, str | dict | None) for x in value)
        return _names(value) if are_names else value
    return _names(value) if isinstance(value, str | dict | Real | None) else value


def _condition(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"must be a condition such as 'x < 0.5 and y > 0', not {show(value)}")
    try:
        return parse(value, POSITION, condition=True).text
    except InputError as error:
        raise ValueError(str(error)) from None


class Scope(NamedTuple):
    """The names that expressions may use in the file that is being read: numbers and tables."""

    numbers: Mapping[str, float] = {}
    tables: Mapping[str, Table] = {}


SCOPE: ContextVar[Scope] = ContextVar("SCOPE", default=Scope())  # noqa: B039
_NAME = re.compile(r"[A-Za-z_]\w*")


def _of_script(value: Any) -> Value:
    """A whole vector or matrix that a script gives where a file has a list."""
    if isinstance(value, Real | str | dict | None):
        raise ValueError(f"must be a list, not {show(value)}")
    return value if isinstance(value, Value) else Value(value)


class ScalarRule(NamedTuple):
    """Reads a number or an expression; ``bound`` is the one infinite number that it accepts.

    A number is ``above`` a bound, ``least`` or more, and ``below`` another bound.  Constants of
    DOLFINx, functions of points, and UFL with ``has_ufl`` pass as they are.
    """

    variables: tuple[str, ...]
    infinite: bool = False
    bound: float | None = None
    has_ufl: bool = False
    above: float = -math.inf
    least: float = -math.inf
    below: float = math.inf

    def __call__(self, value: Any) -> Value:
        if isinstance(value, Value):
            return value
        if isinstance(value, float) and value == self.bound:
            return Value(value)
        if isinstance(value, Tabulated):
            try:
                return Value.of(value, self.variables)
            except InputError as error:
                raise ValueError(str(error)) from None
        is_ufl = hasattr(value, "ufl_shape") and not hasattr(value, "value")
        if self.has_ufl if is_ufl else hasattr(value, "value") or callable(value):
            return Value(value)  # an expression of UFL, a constant of DOLFINx, or a function
        value = plain(value)
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise ValueError(f"must be a number or an expression, not {show(value)}")
        numbers, tables = SCOPE.get()
        try:
            expression = parse(
                value, self.variables, allow_infinite=self.infinite, tables=tables, numbers=numbers
            )
            number = float(expression.numpy()) if expression.is_constant else None
        except InputError as error:
            if isinstance(value, str):
                raise ValueError(str(error)) from None
            raise ValueError(
                f"must be a finite number, not {show(value)}{_reason(value, error)}"
            ) from None
        if number is None:
            return Value(expression.text, expression)
        self._check(number)
        # The name of a number stays in the text, also where the text is a number.
        names = set(_NAME.findall(value)) if isinstance(value, str) else set()
        return Value(expression.text if names & numbers.keys() else number, expression)

    def _check(self, number: float) -> None:
        bounds = (
            (number > self.above or self.above == -math.inf, ">", self.above),
            (number >= self.least, ">=", self.least),
            (number < self.below or self.below == math.inf, "<", self.below),
        )
        for holds, sign, bound in bounds:
            if not holds:
                raise ValueError(f"must be {sign} {show(bound)}, not {show(number)}")
        _not_tiny(number)

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_before_validator_function(self.__call__, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        bounds = {"exclusiveMinimum": self.above, "minimum": self.least}
        bounds["exclusiveMaximum"] = self.below
        kept = {key: bound for key, bound in bounds.items() if math.isfinite(bound)}
        return {"anyOf": [{**kept, "type": "number"}, {"type": "string"}]}


class OneOf(NamedTuple):
    """Marks the choice between the subclasses of a concept by their values of the key ``tag``."""

    tag: str

    def among(self, base: type[Concept]) -> dict[str, type[Concept]]:
        """The subclasses by their tags; a class of a script may have none."""
        tagged = [concept for concept in base.__subclasses__() if self.tag in concept.model_fields]
        return {concept.model_fields[self.tag].default: concept for concept in tagged}

    def __get_pydantic_core_schema__(self, base: Any, handler: Any) -> core_schema.CoreSchema:
        known = self.among(base)
        # It tells the known names where a mapping has none of them.
        unknown = create_model("Unknown", **{self.tag: (Literal[tuple(known)], ...)})  # type: ignore

        def choose(value: Any) -> str:
            name = value.get(self.tag) if isinstance(value, dict) else getattr(value, self.tag, "")
            return f"<one {name if isinstance(name, str) and name in known else 'of them'}>"

        choices = [Annotated[concept, Tag(f"<one {name}>")] for name, concept in known.items()]
        choices.append(Annotated[SkipJsonSchema[unknown], Tag("<one of them>")])  # type: ignore
        union: Any = reduce(operator.or_, choices)
        return handler.generate_schema(Annotated[union, Discriminator(choose)])

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        whole: dict[str, Any] = handler(schema)
        for choice in whole["oneOf"]:
            section = handler.resolve_ref_schema(choice)
            section["required"] = [*{self.tag: None, **dict.fromkeys(section.get("required", ()))}]
        return whole


def _not_zero(value: tuple[T, ...]) -> tuple[T, ...]:
    if all(component == 0 for component in value):
        raise ValueError(f"must not be the zero vector, as in {show(value)}")
    return value


class Component:
    """The present value of one component of a constant of DOLFINx."""

    def __init__(self, constant: Any, number: int) -> None:
        self._constant, self._number = constant, number

    @property
    def value(self) -> float:
        return float(self._constant.value[self._number])

    @property
    def ufl(self) -> Any:
        """The component in UFL."""
        return self._constant[self._number]


def components(value: Any) -> Any:
    """A vector of DOLFINx or UFL by its components, and an array as a list."""
    if np.ndim(getattr(value, "value", 0.0)) == 1:
        return tuple(Component(value, number) for number in range(len(value.value)))
    shape: tuple[int, ...] = getattr(value, "ufl_shape", ())
    return tuple(value[i] for i in range(shape[0])) if len(shape) == 1 else plain(value)


def _square(rows: tuple[tuple[T, ...], ...]) -> tuple[tuple[T, ...], ...]:
    lengths = [len(row) for row in rows]
    if len(rows) not in (3, 4, 6) or set(lengths) != {len(rows)}:
        words = f"rows of the lengths {show(lengths)}" if rows else "nothing"
        raise ValueError(f"must be a 3x3, 4x4 or 6x6 matrix (a list of rows), not {words}")
    return rows


def list_or(tag: str) -> Discriminator:
    """The choice between a list and what has another tag."""
    return Discriminator(lambda value: LIST if isinstance(value, list | tuple) else tag)


# A bound stands before the BeforeValidator, so that it applies to the number that was read.
Number = Annotated[float, BeforeValidator(_finite)]
NumberOrInfinite = Annotated[float, BeforeValidator(_number_or_infinite)]
Positive = Annotated[float, Field(gt=0), BeforeValidator(_finite), AfterValidator(_not_tiny)]
NonNegative = Annotated[float, Field(ge=0), BeforeValidator(_finite), AfterValidator(_not_tiny)]
PositiveOrInfinite = Annotated[
    float, Field(gt=0), BeforeValidator(partial(_number, infinite=True)), AfterValidator(_not_tiny)
]
Tolerance = Annotated[float, Field(gt=0, lt=1), BeforeValidator(_finite), AfterValidator(_not_tiny)]
Share = Annotated[float, Field(gt=0, le=1), BeforeValidator(_finite), AfterValidator(_not_tiny)]
Point = Annotated[tuple[Number, ...], BeforeValidator(plain), PER_AXIS]
Direction = Annotated[Point, AfterValidator(_not_zero)]
Integer = Annotated[int, Field(strict=True), BeforeValidator(_whole)]
Count = Annotated[int, Field(strict=True, ge=1, le=10**9), BeforeValidator(_whole)]
Degree = Annotated[int, Field(strict=True, ge=1, le=2), BeforeValidator(_whole)]
StepCount = Annotated[int, Field(strict=True, ge=1, le=100_000), BeforeValidator(_whole)]
Switch = Annotated[bool, Field(strict=True)]
Text = Annotated[str, Field(strict=True), AfterValidator(_harmless)]
File = Annotated[Text, AfterValidator(_there)]
Names = Annotated[
    tuple[str, ...],
    BeforeValidator(_names, json_schema_input_type=_Name | tuple[_Name, ...]),
]
Places = Annotated[Any, BeforeValidator(_places, json_schema_input_type=_Name | tuple[_Name, ...])]
Along = Annotated[
    Annotated[Literal["normal"], Tag(TEXT)] | Annotated[Direction, Tag(LIST)],
    list_or(TEXT),
    BeforeValidator(lambda value: "normal" if value is None else plain(value)),
]
Condition = Annotated[str, BeforeValidator(_condition)]


def _rule(*variables: str, **options: Any) -> ScalarRule:
    return ScalarRule((*POSITION, *variables), **options)


Scalar = Annotated[Value, _rule(has_ufl=True)]
TimedScalar = Annotated[Value, _rule(TIME)]
TimeScalar = Annotated[Value, ScalarRule((TIME,))]
PositiveScalar = Annotated[Value, _rule(above=0.0, has_ufl=True)]
PositiveScalarOrInfinite = Annotated[Value, _rule(above=0.0, infinite=True, has_ufl=True)]
NegativeScalarOrInfinite = Annotated[Value, _rule(below=0.0, bound=-math.inf, has_ufl=True)]
PoissonScalar = Annotated[Value, _rule(above=-1.0, below=0.5, has_ufl=True)]
NonNegativeSlipScalar = Annotated[Value, _rule("s", least=0.0)]
_Whole = Annotated[SkipJsonSchema[Value], BeforeValidator(_of_script), Tag(SECTION)]
ScalarDirection = Annotated[
    Annotated[tuple[Scalar, ...], AfterValidator(_not_zero), Tag(LIST)] | _Whole,
    list_or(SECTION),
    BeforeValidator(plain),
]
MandelMatrix = Annotated[
    Annotated[tuple[tuple[Scalar, ...], ...], AfterValidator(_square), Tag(LIST)] | _Whole,
    list_or(SECTION),
    BeforeValidator(plain),
]
Strain = Annotated[Value, _rule(TIME, has_ufl=True)]
_Row = Annotated[
    Annotated[tuple[Strain, ...], Tag(LIST)] | Annotated[Strain, Tag(SECTION)], list_or(SECTION)
]
#: A number for the strain ``value I``, a list of normal strains, or the rows of a tensor.
Tensor = Annotated[
    Annotated[tuple[_Row, ...], Tag(LIST)] | Annotated[Strain, Tag(SECTION)],
    list_or(SECTION),
    BeforeValidator(plain),
]
#: A density of loads.
TimedDensity = Strain
TimedVector = Annotated[tuple[TimedDensity, ...], BeforeValidator(components), PER_AXIS]
TimeVector = Annotated[tuple[TimeScalar, ...], BeforeValidator(components), PER_AXIS]
PositiveNumber = Annotated[Value, ScalarRule((), above=0.0)]


def expressions(whole: Concept) -> Iterator[tuple[Place, Value, ScalarRule]]:
    """Place, value and rule of every expression below a concept that is no number."""
    for place, concept in sections(whole):
        for name, (_, rule) in marked(type(concept), ScalarRule).items():
            for inner, value in leaves(getattr(concept, name), place_of(place, concept, name)):
                if isinstance(value, Value) and value.expression and not value.is_constant:
                    yield inner, value, rule
