"""A number at each place and time: a constant, an expression, a table, or data of a script."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic_core import core_schema

from contact_locking.arrays import AXES, LARGEST, FloatArray
from contact_locking.errors import InputError, with_key
from contact_locking.expressions import TIME, Expression, Lookup, parse
from contact_locking.expressions.tree import value_and_gradient
from contact_locking.files import numbers_in, place_of, rows_of
from contact_locking.plain_text import nearest

# An argument may lie outside of the table by this share of its range, which is rounding.
_ROUNDING = 1e-9


class Tabulated:
    """``f(argument)``, linear between ascending points; it has no value beyond them.

    A script may give a table wherever it may give a number or an expression, as in
    ``Traction("top", [0, Tabulated([0, 1], [0, -0.1])])``.  Two tables are equal only if they are
    one.

    Parameters
    ----------
    points
        the ascending arguments (k,), at least two
    values
        f (k,) at the points
    argument
        the expression that is the argument: the time ``t``, the slip ``s``, ``2*x``
    name
        the name in messages

    Raises
    ------
    InputError
        for arrays that are no table
    """

    def __init__(
        self,
        points: npt.ArrayLike,
        values: npt.ArrayLike,
        argument: str = "t",
        name: str = "",
    ) -> None:
        self.points, self.values = _numbers(points, "points"), _numbers(values, "values")
        self.argument, self.name = argument, name
        if len(self.points) != len(self.values):
            raise InputError("must be one number for each point", "Tabulated.values")
        if not np.all(steps := np.diff(self.points) > 0.0):
            after = int(np.argmin(steps))
            message = f"must ascend, but {self.points[after + 1]:g} follows {self.points[after]:g}"
            raise InputError(message, "Tabulated.points")

    @classmethod
    def read(
        cls, file: str | Path, over: str, column: str, argument: str = "t", name: str = ""
    ) -> Tabulated:
        """The table of two columns of a CSV file, whose first row has the names of the columns.

        ``over`` is the column of the points, and ``column`` that of the values.  Raises InputError
        with one of these keys for a file that cannot be used.
        """
        path = Path(file)
        with rows_of(path, "file") as rows:
            header = [title.strip() for title in next(rows, [])]
            places = {
                title: with_key(key, partial(place_of, title, header, path))
                for key, title in (("over", over), ("column", column))
            }
            numbers = with_key("file", partial(numbers_in, rows, places, path))
        points, values = np.array(numbers, dtype=float).reshape(-1, len(places))[:, [0, -1]].T
        try:
            return cls(points, values, argument, name)
        except InputError as error:
            is_over = str(error.key).endswith("points")
            raise InputError(f"{file}: {error}", "over" if is_over else "column") from None

    def __call__(self, argument: Any) -> Any:
        """The values at arguments, NaN where the table has none."""
        low, high = self.points[[0, -1]]
        room = _ROUNDING * (high - low)
        inside = (argument >= low - room) & (argument <= high + room)
        return np.where(inside, self.clamped(argument), np.nan)

    def clamped(self, argument: Any) -> Any:
        """The values at arguments, beyond the points that of the nearest point."""
        return np.interp(argument, self.points, self.values)

    def slope(self, argument: Any) -> Any:
        """The derivatives at arguments, at a point of the table the one to its right."""
        slopes = np.diff(self.values) / np.diff(self.points)
        place = np.searchsorted(self.points, argument, side="right") - 1
        return slopes[np.clip(place, 0, len(slopes) - 1)]

    def __str__(self) -> str:
        low, high = self.points[[0, -1]]
        name = f" '{self.name}'" if self.name else ""
        return f"table{name} has values from {low:.6g} to {high:.6g}"


def _numbers(data: npt.ArrayLike, key: str) -> FloatArray:
    try:
        array = np.array(data).astype(float, casting="same_kind")
    except (TypeError, ValueError):
        raise InputError("must be numbers (k,)", f"Tabulated.{key}") from None
    if array.ndim != 1 or len(array) < 2:
        raise InputError("must be at least 2 numbers (k,)", f"Tabulated.{key}")
    if not np.all(is_number := np.abs(array) <= LARGEST):
        message = f"must be numbers of at most {LARGEST:g}, and number {np.argmin(is_number) + 1}"
        raise InputError(f"{message} is {array[np.argmin(is_number)]:g}", f"Tabulated.{key}")
    return array


@dataclass(frozen=True, eq=False)
class Value:
    """``f(x, t)``, or ``f(x, s)`` of a slip s.

    ``data`` is what was written: a number, a text with an expression of x, y, z, t and tables, a
    table, a constant of DOLFINx, or a function of points (d, k) with values (k,).  ``expression``
    is what a number, a text or a table means, None for the data of a script.
    """

    data: Any
    expression: Expression | None = None

    @classmethod
    def of(cls, data: Any, variables: Sequence[str] = (*AXES, TIME)) -> Value:
        """The value of a number, a text in some variables, a table, or data of a script."""
        if isinstance(data, Value):
            return data
        if isinstance(data, Tabulated):
            tables = {"table": data}
            return cls(data, parse(f"table({data.argument})", variables, tables=tables))
        if isinstance(data, int | float | str):
            return cls(data, parse(data, variables))
        return cls(data)

    @cached_property
    def number(self) -> float | None:
        """The number that it is at all places and times, None if it may change."""
        if isinstance(self.data, int | float):
            return float(self.data)
        if self.expression is None or not self.expression.is_constant:
            return None
        return float(self.expression.numpy())

    @property
    def is_constant(self) -> bool:
        """Whether it is one number at all places and times."""
        return self.number is not None

    @property
    def is_timed(self) -> bool:
        """Whether it may change from solve to solve."""
        return self.expression is None or TIME in self.expression.names

    def at(
        self,
        points: FloatArray,
        time: float = 0.0,
        shape: tuple[int, ...] = (),
        **variables: FloatArray,
    ) -> FloatArray:
        """The values (k, ...) of a shape at points (d, k) and a time.

        ``variables`` are the values (k,) of further variables.  Raises InputError for a value of an
        expression that is not finite.
        """
        values: Any = self.number
        if values is None and self.expression is not None:
            values = self.expression.numpy(**_variables(points, time), **variables)
        elif values is None:
            # A constant of DOLFINx can be called as well.
            is_constant = hasattr(self.data, "value")
            values = self.data.value if is_constant else self.data(points)
        whole = (*points.shape[1:], *shape)
        return np.broadcast_to(np.asarray(values, dtype=float), whole).copy()

    def require_times(self, place: FloatArray, times: Sequence[float]) -> None:
        """Raise InputError if a table of t alone leaves no value at a time, at the place (d, 1)."""
        for lookup in self.expression.lookups if self.expression else ():
            for time in times if lookup.names == {TIME} else ():
                if np.isnan(lookup.table(lookup.argument_at(**{TIME: time}))):
                    self.at(place, time)

    def unchecked(
        self,
        points: FloatArray,
        time: float = 0.0,
        tables: Mapping[Lookup, FloatArray] | None = None,
        **variables: Any,
    ) -> FloatArray:
        """The values (k,) of an expression at points (d, k), infinite or NaN where it has none.

        ``tables`` has values (k,) that stand in for those of tables.
        """
        assert self.expression is not None
        values = self.expression.unchecked(tables, **_variables(points, time), **variables)
        return np.broadcast_to(values, points.shape[1:])

    def with_gradient(self, points: FloatArray, time: float) -> tuple[FloatArray, FloatArray]:
        """The values (k,) of an expression and its gradient (d, k) at points (d, k)."""
        assert self.expression is not None
        axes = AXES[: len(points)]
        return value_and_gradient(self.expression, axes, _variables(points, time))

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> core_schema.CoreSchema:
        # What reads a value stands before its type (`kinds.ScalarRule`); it is written as its data.
        written = core_schema.plain_serializer_function_ser_schema(lambda value: value.data)
        return core_schema.is_instance_schema(cls, serialization=written)

    def __eq__(self, other: object) -> bool:
        return bool(self.data == (other.data if isinstance(other, Value) else other))

    def __hash__(self) -> int:
        return hash(self.data)

    def __float__(self) -> float:
        return float(self.data if self.number is None else self.number)

    def __str__(self) -> str:
        return str(self.data)

    def __repr__(self) -> str:
        return repr(self.data)


def _variables(points: FloatArray, time: float) -> dict[str, Any]:
    return {**dict(zip(AXES, points, strict=False)), TIME: time}


def vector_at(components: Sequence[Value], time: float) -> FloatArray:
    """The components (d,) at a time of a vector that is the same everywhere."""
    return np.array([float(component.at(np.empty((0, 1)), time)[0]) for component in components])


# Texts that YAML takes as they stand, and words that YAML takes for something else.
_PLAIN = re.compile(r"[^\W\d][\w ./*+^()-]*")
_WORDS = {"null", "true", "false", "yes", "no", "on", "off"}

#: By pydantic's name of an error; the words in braces are from the error's context.
_MESSAGES = {
    "greater_than": "must be > {gt}, not {given}",
    "greater_than_equal": "must be >= {ge}, not {given}",
    "less_than": "must be < {lt}, not {given}",
    "less_than_equal": "must be <= {le}, not {given}",
    "too_short": "has {actual_length} entries; at least {min_length} are needed",
    "too_long": "has {actual_length} entries; at most {max_length} are allowed",
    "bool_type": "must be true or false, not {given}",
    "int_type": "must be an integer, not {given}",
    "string_type": "must be text (in quotes, if it looks like a number), not {given}",
    "list_type": "must be a list{how_to_list}, not {given}",
    "tuple_type": "must be a list{how_to_list}, not {given}",
    "missing": "is missing",
    "extra_forbidden": "is not known here",
}


def show(value: Any) -> str:
    """A value as a message repeats it: in YAML's words and not too long."""
    match value:
        case Value():
            return show(value.data)
        case None:
            return "null"
        case bool():
            return str(value).lower()
        case float() if math.isnan(value):
            return ".nan"
        case float() if math.isinf(value):
            return ".inf" if value > 0 else "-.inf"
        case int():
            text = "a huge integer" if abs(value) >= 10**20 else str(value)
        case float():
            text = f"{value:g}" if float(f"{value:g}") == value else str(value)
        case list() | tuple():
            text = f"[{', '.join(map(entry, value[:10]))}{', ...' * (len(value) > 10)}]"
        case dict():
            pairs = [f"{key}: {entry(inner)}" for key, inner in list(value.items())[:10]]
            text = f"{{{', '.join(pairs)}}}"
        case str():
            text = repr(value)
        case _:
            text = f"'{value}'"
    return text if len(text) <= 80 else f"{text[:77]}..."


def entry(value: Any) -> str:
    """A value as an entry of a list: a name is without quotes there, as in a study file."""
    plain = isinstance(value, str) and _PLAIN.fullmatch(value) and value.lower() not in _WORDS
    return value if plain else show(value)


def value_message(details: Any) -> str:
    """The message for an error of pydantic about one value."""
    if cause := details.get("ctx", {}).get("error"):
        return str(cause)
    value = details["input"]
    if details["type"] == "literal_error":
        allowed = details["ctx"]["expected"].replace("'", "")
        guess = nearest(str(value), allowed.replace(" or ", ", ").split(", "))
        return f"must be {allowed}, not {show(value)}{guess}"
    in_a_mapping = ", or of entries that begin with '- '" if isinstance(value, dict) else ""
    template = _MESSAGES.get(details["type"])
    if template is None:
        return f"cannot be {show(value)}: {details['msg'][:1].lower()}{details['msg'][1:]}"
    context = {name: show(bound) for name, bound in details.get("ctx", {}).items()}
    return template.format(given=show(value), how_to_list=f" in [ ]{in_a_mapping}", **context)
