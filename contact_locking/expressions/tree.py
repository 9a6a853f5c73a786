"""Expressions as trees of a few operations: their values in NumPy and in UFL, and gradients."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from contact_locking.arrays import LARGEST, FloatArray
from contact_locking.errors import InputError

POSITION = ("x", "y", "z")
#: The time of a problem with steps.
TIME = "t"
CONSTANTS = {"pi": math.pi, "e": math.e}
# With the number of their arguments; None stands for two or more.
FUNCTIONS: dict[str, int | None] = {
    **dict.fromkeys(("sin", "cos", "tan", "asin", "acos", "atan"), 1),
    **dict.fromkeys(("sinh", "cosh", "tanh", "exp", "log", "sqrt", "abs", "sign"), 1),
    "atan2": 2,
    "min": None,
    "max": None,
}
MAX_LENGTH = 1000
MAX_DEPTH = 40
MAX_EXPONENT = 100.0
# Characters of an expression that a message repeats.
_SHOWN = 60

OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Pow: "**",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.And: "and",
    ast.Or: "or",
}


def shortened(text: str) -> str:
    """The beginning of an expression, as messages repeat it."""
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."


NUMPY: dict[str, Callable[..., Any]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "**": np.power,
    "negative": np.negative,
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
    "==": np.equal,
    "!=": np.not_equal,
    "and": np.logical_and,
    "or": np.logical_or,
    "not": np.logical_not,
    "if": np.where,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "min": np.minimum,
    "max": np.maximum,
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    **{name: getattr(np, name) for name in ("exp", "log", "sqrt", "abs", "sign")},
}


@cache
def ufl_operations() -> dict[str, Callable[..., Any]]:
    """The operations in UFL, which is imported only when a form is built."""
    import operator

    import ufl
    from ufl.algebra import Abs

    def absolute(a: Any) -> Any:
        # In UFL, abs of an abs becomes its own operand, and traversals of it never end.
        return a if isinstance(a, Abs) else abs(a)

    return {
        "+": operator.add,
        "-": operator.sub,
        "*": operator.mul,
        "/": operator.truediv,
        "**": operator.pow,
        "negative": operator.neg,
        "<": ufl.lt,
        "<=": ufl.le,
        ">": ufl.gt,
        ">=": ufl.ge,
        "==": ufl.eq,
        "!=": ufl.ne,
        "and": ufl.And,
        "or": ufl.Or,
        "not": ufl.Not,
        "if": ufl.conditional,
        "log": ufl.ln,
        "abs": absolute,
        "min": ufl.min_value,
        "max": ufl.max_value,
        **{name: getattr(ufl, name) for name in ("sin", "cos", "tan", "asin", "acos", "atan")},
        **{name: getattr(ufl, name) for name in ("sinh", "cosh", "tanh", "exp", "sqrt")},
        **{name: getattr(ufl, name) for name in ("sign", "atan2")},
    }


class Table(Protocol):
    """A function of one argument, NaN where it has no value."""

    def __call__(self, argument: Any) -> Any: ...

    def clamped(self, argument: Any) -> Any:
        """The values at arguments, that of the nearest point where there is none."""

    def slope(self, argument: Any) -> Any:
        """The derivatives at arguments."""


NO_TABLES: Mapping[str, Table] = {}
NO_NUMBERS: Mapping[str, float] = {}


@dataclass(frozen=True)
class Number:
    """A number."""

    value: float


@dataclass(frozen=True)
class Name:
    """A variable."""

    name: str


@dataclass(frozen=True)
class Apply:
    """An operation, by its name in `operations`, applied to its arguments."""

    operation: str
    arguments: tuple[Node, ...]


@dataclass(frozen=True)
class Lookup:
    """The value of a table at its argument."""

    table: Table
    argument: Node

    @property
    def names(self) -> frozenset[str]:
        """The variables of the argument."""
        return frozenset(node.name for node in _nodes(self.argument) if isinstance(node, Name))

    def is_over(self, name: str) -> bool:
        """Whether the argument is the variable of this name alone."""
        return self.argument == Name(name)

    def argument_at(self, **variables: Any) -> Any:
        """The values of the argument in NumPy."""
        with np.errstate(all="ignore"):
            return _evaluate(self.argument, NUMPY, variables, _value)


Node = Number | Name | Apply | Lookup


def _nodes(root: Node) -> Iterator[Node]:
    """The nodes of a tree, from the leaves to the root."""
    match root:
        case Apply(_, arguments):
            for argument in arguments:
                yield from _nodes(argument)
        case Lookup(_, argument):
            yield from _nodes(argument)
    yield root


def _value(lookup: Lookup, argument: Any) -> Any:
    return lookup.table(argument)


def _evaluate(
    node: Node,
    operations: Mapping[str, Callable[..., Any]],
    variables: Mapping[str, Any],
    look_up: Callable[[Lookup, Any], Any],
) -> Any:
    match node:
        case Number(value):
            return value
        case Name(name):
            return variables[name]
        case Apply(operation, arguments):
            values = [_evaluate(operand, operations, variables, look_up) for operand in arguments]
            return operations[operation](*values)
        case Lookup(_, argument):
            return look_up(node, _evaluate(argument, operations, variables, look_up))


@dataclass(frozen=True)
class Expression:
    """A number or a formula in named variables, made by `parse`."""

    text: str
    allow_infinite: bool
    root: Node

    @cached_property
    def names(self) -> frozenset[str]:
        """The variables of the formula."""
        return frozenset(node.name for node in _nodes(self.root) if isinstance(node, Name))

    @cached_property
    def lookups(self) -> tuple[Lookup, ...]:
        """The different values of tables in the formula."""
        return tuple(dict.fromkeys(n for n in _nodes(self.root) if isinstance(n, Lookup)))

    @property
    def is_constant(self) -> bool:
        """Whether the expression has neither variables nor tables."""
        return not self.names and not self.lookups

    def numpy(self, **variables: npt.ArrayLike) -> Any:
        """The values at the given points: an array of the broadcast shape of the variables.

        The value is a float if all variables are numbers, or none is given. Variables that do not
        occur in the expression contribute only their shape. Raises InputError if a value is not a
        number, is infinite (plus infinity passes with ``allow_infinite``) or exceeds `LARGEST`.
        """
        values = self.unchecked(**variables)
        good = np.abs(values) <= LARGEST
        if self.allow_infinite:
            good |= values == np.inf
        if not good.all():
            first = tuple(np.argwhere(~good)[0])
            place = ", ".join(
                f"{name} = {float(np.broadcast_to(variables[name], values.shape)[first]):.6g}"
                for name in sorted(self.names)
            )
            raise InputError(
                f"the expression '{shortened(self.text)}' is {values[first]:g}"
                f"{f' at {place}' if place else ''}; it has to be a finite number"
                f"{f' of at most {LARGEST:g}' if np.isfinite(values[first]) else ''}"
                f"{''.join(f'; the {lookup.table}' for lookup in self.lookups)}"
            )
        return values if values.shape else float(values)

    def unchecked(
        self, known: Mapping[Lookup, Any] | None = None, /, **variables: npt.ArrayLike
    ) -> npt.NDArray[np.float64]:
        """The values of :meth:`numpy`, infinite or NaN where the expression has none.

        ``known`` are values to take in place of those of some tables.
        """
        known = known or {}
        arrays = {name: np.asarray(value, dtype=float) for name, value in variables.items()}
        shape = np.broadcast_shapes(*(array.shape for array in arrays.values()))
        with np.errstate(all="ignore"):
            value = _evaluate(
                self.root,
                NUMPY,
                arrays,
                lambda lookup, at: known[lookup] if lookup in known else _value(lookup, at),
            )
        return np.array(np.broadcast_to(value, shape), dtype=float)

    def ufl(self, lookups: Mapping[Lookup, Any] | None = None, /, **variables: Any) -> Any:
        """The expression in UFL, with UFL scalars for the variables; a float for a constant.

        ``lookups`` has the UFL scalars of the tables.  Raises InputError if UFL finds that the
        expression is defined nowhere, such as ``1/(0*x)``.
        """
        if self.is_constant:
            return self.numpy()
        try:
            values = lookups or {}
            return _evaluate(
                self.root, ufl_operations(), variables, lambda lookup, _: values[lookup]
            )
        except (ArithmeticError, ValueError) as error:
            raise InputError(
                f"the expression '{shortened(self.text)}' is not defined: {error}"
            ) from error


#: For each operation the partial derivatives by its arguments, from the arguments and the value.
_PARTIALS: dict[str, Callable[..., tuple[Any, ...]]] = {
    "+": lambda a, b, value: (1.0, 1.0),
    "-": lambda a, b, value: (1.0, -1.0),
    "*": lambda a, b, value: (b, a),
    "/": lambda a, b, value: (1.0 / b, -value / b),
    # The derivative by the exponent is needed only if the exponent depends on the variables.
    "**": lambda a, b, value: (b * np.power(a, b - 1.0), value * np.log(a)),
    "negative": lambda a, value: (-1.0,),
    "sin": lambda a, value: (np.cos(a),),
    "cos": lambda a, value: (-np.sin(a),),
    "tan": lambda a, value: (1.0 + value**2,),
    "asin": lambda a, value: (1.0 / np.sqrt(1.0 - a**2),),
    "acos": lambda a, value: (-1.0 / np.sqrt(1.0 - a**2),),
    "atan": lambda a, value: (1.0 / (1.0 + a**2),),
    "sinh": lambda a, value: (np.cosh(a),),
    "cosh": lambda a, value: (np.sinh(a),),
    "tanh": lambda a, value: (1.0 - value**2,),
    "exp": lambda a, value: (value,),
    "log": lambda a, value: (1.0 / a,),
    "sqrt": lambda a, value: (0.5 / value,),
    "abs": lambda a, value: (np.sign(a),),
    "sign": lambda a, value: (0.0,),
    "atan2": lambda a, b, value: (b / (a**2 + b**2), -a / (a**2 + b**2)),
    "min": lambda a, b, value: (np.where(a <= b, 1.0, 0.0), np.where(a <= b, 0.0, 1.0)),
    "max": lambda a, b, value: (np.where(a >= b, 1.0, 0.0), np.where(a >= b, 0.0, 1.0)),
}


def value_and_gradient(
    expression: Expression, by: Sequence[str], variables: Mapping[str, Any]
) -> tuple[FloatArray, FloatArray]:
    """The values (k,) and the derivatives (d, k) by the d variables named in ``by``.

    The derivatives are exact, and one-sided at kinks such as that of ``abs``; they may be infinite
    or not a number, such as those of ``sqrt(x)`` at 0.  Raises InputError for values that are not
    finite.
    """
    values = np.atleast_1d(np.asarray(expression.numpy(**variables)))
    with np.errstate(all="ignore"):
        slopes = _forward(expression.root, by, variables)[1]
    gradient = [np.broadcast_to(np.asarray(slopes.get(name, 0.0)), values.shape) for name in by]
    return values, np.array(gradient, dtype=float)


def _forward(node: Node, by: Sequence[str], variables: Mapping[str, Any]) -> tuple[Any, Any]:
    """The value of a node, and its derivatives by the names that it depends on."""
    match node:
        case Number(value):
            return value, {}
        case Name(name):
            return variables[name], {name: 1.0} if name in by else {}
        case Lookup(table, argument):
            value, slopes = _forward(argument, by, variables)
            slope = table.slope(value) if slopes else 0.0
            return table(value), {name: slope * inner for name, inner in slopes.items()}
        case Apply(operation, arguments):
            parts = [_forward(argument, by, variables) for argument in arguments]
            values = [value for value, _ in parts]
            result = NUMPY[operation](*values)
            if not any(slopes for _, slopes in parts):
                return result, {}
            if operation == "if":
                condition, (_, first), (_, other) = values[0], *parts[1:]
                names = first.keys() | other.keys()
                chosen = {
                    name: np.where(condition, first.get(name, 0.0), other.get(name, 0.0))
                    for name in names
                }
                return result, chosen
            if operation not in _PARTIALS:
                return result, {}  # A comparison is constant but for its jumps.
            total: dict[str, Any] = {}
            partials = _PARTIALS[operation](*values, result)
            # A factor without a slope is left out, as its partial derivative may be infinite.
            for partial, (_, slopes) in zip(partials, parts, strict=True):
                for name, slope in slopes.items():
                    total[name] = total.get(name, 0.0) + partial * slope
            return result, total
