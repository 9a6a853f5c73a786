"""Expressions of the study file: parsed through a whitelist, evaluated by NumPy or turned into UFL.

A study file may come from anybody, so nothing in it is ever evaluated by Python. The text is
parsed with ``ast`` into a tree of the few nodes below, and everything else is refused.

========== ==================================================================
numbers    ``2``, ``0.5``, ``1e-3``, ``pi``, ``e`` (and ``inf`` where it makes sense)
operators  ``+ - * / **``, and ``< <= > >= == != and or not`` inside conditions
choice    ``a if condition else b``
functions  those of `FUNCTIONS`
========== ==================================================================
"""

from __future__ import annotations

import ast
import difflib
import math
import re
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, reduce
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from contact_locking.errors import InputError

POSITION = ("x", "y", "z")
CONSTANTS = {"pi": math.pi, "e": math.e}
# Number of arguments; None stands for two or more.
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
# No quantity has such values in any unit, and products of three of them stay in double precision;
# what is divided by is not smaller than the second.
LARGEST, SMALLEST = 1e100, 1e-100
# Such as 210 GPa.
_WITH_UNIT = re.compile(r"[-+]?[\d.]+(e[-+]?\d+)? *[^\W\d_]+(/\w+)?\d?", re.IGNORECASE)
_SHOWN = 60  # characters of an expression that a message repeats

_OPERATORS: dict[type[ast.AST], str] = {
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

_NUMPY: dict[str, Callable[..., Any]] = {
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
def _ufl() -> dict[str, Callable[..., Any]]:
    """The same operations in UFL, which is imported only when a form is built."""
    import operator

    import ufl
    from ufl.algebra import Abs

    def absolute(a: Any) -> Any:
        # UFL's abs of an abs makes it its own operand, and whatever walks through it never ends.
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


@dataclass(frozen=True)
class _Number:
    value: float


@dataclass(frozen=True)
class _Name:
    name: str


@dataclass(frozen=True)
class _Apply:
    operation: str
    arguments: tuple[_Node, ...]


_Node = _Number | _Name | _Apply


def _evaluate(
    node: _Node, operations: Mapping[str, Callable[..., Any]], variables: Mapping[str, Any]
) -> Any:
    match node:
        case _Number(value):
            return value
        case _Name(name):
            return variables[name]
        case _Apply(operation, arguments):
            values = [_evaluate(argument, operations, variables) for argument in arguments]
            return operations[operation](*values)


@dataclass(frozen=True)
class Expression:
    """A number or a formula in named variables, made by `parse`."""

    text: str
    names: frozenset[str]
    allow_infinite: bool
    _root: _Node

    @property
    def is_constant(self) -> bool:
        """Whether no variable occurs in it."""
        return not self.names

    def numpy(self, **variables: npt.ArrayLike) -> Any:
        """Value at the given points: an array of the broadcast shape of the variables.

        A float when all variables are numbers (or none is given). Variables that do not occur
        only contribute their shape. Raises InputError where the value is not finite (or, where
        an infinite value makes sense, not a number or minus infinity), or larger than `LARGEST`.
        """
        self._require(variables)
        arrays = {name: np.asarray(value, dtype=float) for name, value in variables.items()}
        shape = np.broadcast_shapes(*(array.shape for array in arrays.values()))
        with np.errstate(all="ignore"):
            value = _evaluate(self._root, _NUMPY, arrays)
        values = np.array(np.broadcast_to(value, shape), dtype=float)
        good = np.abs(values) <= LARGEST
        if self.allow_infinite:
            good |= values == np.inf
        if not good.all():
            first = tuple(np.argwhere(~good)[0])
            place = ", ".join(
                f"{name} = {np.broadcast_to(arrays[name], shape)[first]:.6g}"
                for name in sorted(self.names)
            )
            raise InputError(
                f"the expression '{_short(self.text)}' is {values[first]:g}"
                f"{f' at {place}' if place else ''}; it has to be a finite number"
                f"{f' of at most {LARGEST:g}' if np.isfinite(values[first]) else ''}"
            )
        return values if shape else float(values)

    def ufl(self, **variables: Any) -> Any:
        """The UFL expression (a float for a constant) with UFL scalars put for the variables.

        Raises InputError where UFL finds that it is not defined anywhere, such as ``1/(0*x)``.
        """
        self._require(variables)
        if self.is_constant:
            return self.numpy()
        try:
            return _evaluate(self._root, _ufl(), variables)
        except (ArithmeticError, ValueError) as error:
            raise InputError(
                f"the expression '{_short(self.text)}' is not defined: {error}"
            ) from error

    def _require(self, variables: Mapping[str, Any]) -> None:
        if missing := self.names - variables.keys():
            raise TypeError(f"'{_short(self.text)}' needs a value of {', '.join(sorted(missing))}")


def parse(
    value: float | str, variables: Sequence[str] = POSITION, *, allow_infinite: bool = False
) -> Expression:
    """The expression that a number or a text stands for.

    ``variables`` are the names that may occur. With ``allow_infinite`` the value may be
    infinite, and ``inf`` is a known constant. Raises InputError that says what is wrong, where,
    and the nearest known name.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise InputError(f"expected a number or an expression, not {value!r}")
    if isinstance(value, str):
        return _Parser(value, tuple(variables), allow_infinite).expression()
    try:
        number = float(value)
    except OverflowError:
        raise InputError("the number is too large") from None
    if not (number > -math.inf if allow_infinite else math.isfinite(number)):
        raise InputError(f"expected a finite number, not {number:g}")
    if LARGEST < abs(number) < math.inf:
        hint = " or .inf" if allow_infinite else ""
        raise InputError(f"the number is too large; give one of at most {LARGEST:g}{hint}")
    return Expression(f"{value}", frozenset(), allow_infinite, _Number(number))


class _Parser:
    """Recursive descent over Python's syntax tree; numbers and conditions are kept apart."""

    def __init__(self, text: str, variables: tuple[str, ...], allow_infinite: bool) -> None:
        self.text = " ".join(text.split())
        self.variables = variables
        self.allow_infinite = allow_infinite
        self.constants = CONSTANTS | ({"inf": math.inf} if allow_infinite else {})
        self.names: set[str] = set()

    def expression(self) -> Expression:
        if not self.text:
            raise InputError("an empty text is neither a number nor an expression")
        if len(self.text) > MAX_LENGTH:
            raise InputError(
                f"the expression has {len(self.text)} characters; at most {MAX_LENGTH} are allowed"
            )
        if "#" in self.text or not self.text.isprintable():
            raise InputError(f"{self.text[:_SHOWN]!r} is not an expression")
        try:
            with warnings.catch_warnings():
                # '1if x<0 else 2' and the like: Python warns, we have our own opinion.
                warnings.simplefilter("ignore")
                tree = ast.parse(self.text, mode="eval")
        except SyntaxError as error:
            column = f" (at character {error.offset})" if error.offset else ""
            unit = "; a number has no unit" if _WITH_UNIT.fullmatch(self.text) else ""
            raise InputError(f"{self.shown()}: {error.msg}{column}{unit}") from None
        except (ValueError, RecursionError, MemoryError):
            raise InputError(f"{self.shown()}: it cannot be read as a formula") from None
        root = self.number(tree.body, 0)
        return Expression(self.text, frozenset(self.names), self.allow_infinite, root)

    def number(self, node: ast.expr, depth: int) -> _Node:
        self.check_depth(node, depth)
        below = depth + 1
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                return self.literal(node, value)
            case ast.Name(id=name):
                return self.name(node, name)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.number(operand, below)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self.apply(node, "negative", self.number(operand, below))
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                a, b = self.number(left, below), self.number(right, below)
                exponent = b.value if isinstance(op, ast.Pow) and isinstance(b, _Number) else 0.0
                if abs(exponent) > MAX_EXPONENT:
                    self.refuse(right, f"exponents are limited to {MAX_EXPONENT:g}")
                return self.apply(node, _OPERATORS[type(op)], a, b)
            case ast.BinOp(op=ast.BitXor()):
                self.refuse(node, "a power is written **, not ^")
            case ast.IfExp(test=test, body=body, orelse=orelse):
                condition = self.condition(test, below)
                return self.apply(
                    node, "if", condition, self.number(body, below), self.number(orelse, below)
                )
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
                return self.call(node, name, args, below)
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp(op=ast.Not()):
                self.refuse(node, "a condition is not a number; write '1 if ... else 0'")
        self.refuse(node, "only numbers, names, + - * / **, if-else and functions are allowed")

    def condition(self, node: ast.expr, depth: int) -> _Node:
        self.check_depth(node, depth)
        below = depth + 1
        match node:
            case ast.Compare(left=left, ops=ops, comparators=others) if all(
                type(op) in _OPERATORS for op in ops
            ):
                terms = [self.number(term, below) for term in (left, *others)]
                pairs = zip(ops, terms, terms[1:], strict=False)
                return reduce(
                    lambda a, b: _Apply("and", (a, b)),
                    [_Apply(_OPERATORS[type(op)], (a, b)) for op, a, b in pairs],
                )
            case ast.BoolOp(op=op, values=values):
                operation = _OPERATORS[type(op)]
                conditions = [self.condition(value, below) for value in values]
                return reduce(lambda a, b: _Apply(operation, (a, b)), conditions)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return _Apply("not", (self.condition(operand, below),))
        self.refuse(node, "expected a condition such as x < 0.5")

    def literal(self, node: ast.expr, value: float) -> _Node:
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            self.refuse(node, "the number is too large")
        return _Number(number)

    def name(self, node: ast.expr, name: str) -> _Node:
        if name in self.variables:
            self.names.add(name)
            return _Name(name)
        if name in self.constants:
            return _Number(self.constants[name])
        if name in FUNCTIONS:
            self.refuse(node, f"the function {name} needs arguments in parentheses")
        known = [*self.variables, *self.constants]
        guess = nearest(name, known)
        self.refuse(node, f"unknown name '{name}'{guess}; known: {', '.join(known)}")

    def call(self, node: ast.expr, name: str, args: list[ast.expr], depth: int) -> _Node:
        if name not in FUNCTIONS:
            guess = nearest(name, FUNCTIONS)
            self.refuse(node, f"unknown function '{name}'{guess}; known: {', '.join(FUNCTIONS)}")
        arity = FUNCTIONS[name]
        if (len(args) < 2) if arity is None else (len(args) != arity):
            wanted = "two or more arguments" if arity is None else f"{arity} argument(s)"
            self.refuse(node, f"{name} takes {wanted}, not {len(args)}")
        arguments = [self.number(argument, depth) for argument in args]
        if arity is None:
            return reduce(lambda a, b: self.apply(node, name, a, b), arguments)
        return self.apply(node, name, *arguments)

    def apply(self, node: ast.expr, operation: str, *arguments: _Node) -> _Node:
        """The operation, carried out at once if all arguments are numbers.

        UFL would do the same with Python floats, where 1/0 and sqrt(-1) are exceptions.
        """
        values = [argument.value for argument in arguments if isinstance(argument, _Number)]
        if len(values) < len(arguments):
            return _Apply(operation, arguments)
        with np.errstate(all="ignore"):
            value = float(_NUMPY[operation](*values))
        if math.isnan(value) or (math.isinf(value) and not self.allow_infinite):
            self.refuse(node, f"the value is {value:g}")
        return _Number(value)

    def check_depth(self, node: ast.expr, depth: int) -> None:
        if depth > MAX_DEPTH:
            self.refuse(node, f"more than {MAX_DEPTH} operations are nested")

    def refuse(self, node: ast.expr, reason: str) -> NoReturn:
        part = ast.get_source_segment(self.text, node) or self.text
        # ast counts bytes
        column = len(self.text.encode()[: node.col_offset].decode()) + 1
        place = "" if part == self.text else f", at character {column} ('{_short(part)}')"
        raise InputError(f"{self.shown()}{place}: {reason}")

    def shown(self) -> str:
        return f"in the expression '{_short(self.text)}'"


def _short(text: str) -> str:
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."


def nearest(name: str, known: Iterable[str]) -> str:
    """The hint at the known name most like ``name``; empty if none is."""
    matches = difflib.get_close_matches(name, list(known), n=1)
    return f" (did you mean '{matches[0]}'?)" if matches else ""
