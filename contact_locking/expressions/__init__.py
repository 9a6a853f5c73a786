"""Expressions of the study file: read through a whitelist, evaluated by NumPy or turned into UFL.

========== ==================================================================
numbers    ``2``, ``0.5``, ``1e-3``, ``pi``, ``e`` (and ``inf`` where a value may be infinite)
operators  ``+ - * / **``, and ``< <= > >= == != and or not`` inside conditions
choice     ``a if condition else b``
functions  those of `FUNCTIONS`
tables     ``name(argument)`` with the name of a `Table`
========== ==================================================================

A study file may come from anybody, so Python never evaluates any part of it. The text is parsed
with ``ast`` into a tree of the few nodes of :mod:`tree`, and everything else is refused.
"""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Mapping, Sequence
from functools import reduce
from typing import NoReturn

import numpy as np

from contact_locking.arrays import LARGEST
from contact_locking.errors import InputError
from contact_locking.expressions.tree import CONSTANTS as CONSTANTS
from contact_locking.expressions.tree import FUNCTIONS as FUNCTIONS
from contact_locking.expressions.tree import MAX_DEPTH as MAX_DEPTH
from contact_locking.expressions.tree import (
    MAX_EXPONENT,
    NO_NUMBERS,
    NUMPY,
    OPERATORS,
    Apply,
    Name,
    Node,
    Number,
    shortened,
)
from contact_locking.expressions.tree import MAX_LENGTH as MAX_LENGTH
from contact_locking.expressions.tree import NO_TABLES as NO_TABLES
from contact_locking.expressions.tree import POSITION as POSITION
from contact_locking.expressions.tree import TIME as TIME
from contact_locking.expressions.tree import Expression as Expression
from contact_locking.expressions.tree import Lookup as Lookup
from contact_locking.expressions.tree import Table as Table
from contact_locking.plain_text import nearest

# Such as 210 GPa.
_WITH_UNIT = re.compile(r"[-+]?[\d.]+(e[-+]?\d+)? *[^\W\d_]+(/\w+)?\d?", re.IGNORECASE)

_GRAMMAR = (
    f"numbers, names, + - * / **, if-else and the functions {', '.join(FUNCTIONS)} are allowed"
)


def parse(
    value: float | str,
    variables: Sequence[str] = POSITION,
    *,
    allow_infinite: bool = False,
    tables: Mapping[str, Table] = NO_TABLES,
    numbers: Mapping[str, float] = NO_NUMBERS,
    condition: bool = False,
) -> Expression:
    """The expression of a number or a text in the given variables and tables.

    ``numbers`` are further constants by their names.
    With ``condition`` the text is a condition such as x < 0, and the expression 1 where it holds
    and 0 elsewhere.
    With ``allow_infinite`` the value may be plus infinity, and ``inf`` is a known constant. Raises
    InputError that names the fault, its place in the text and the nearest known name.
    """
    if isinstance(value, str):
        parser = _Parser(value, tuple(variables), allow_infinite, tables, numbers)
        return parser.expression(condition)
    try:
        number = float(value)
    except OverflowError:
        raise InputError("the number is too large") from None
    if not (number > -math.inf if allow_infinite else math.isfinite(number)):
        raise InputError(f"expected a finite number, not {number:g}")
    if LARGEST < abs(number) < math.inf:
        hint = " or .inf" if allow_infinite else ""
        raise InputError(f"the number is too large; give one of at most {LARGEST:g}{hint}")
    return Expression(f"{value}", allow_infinite, Number(number))


class _Parser:
    """Recursive descent through Python's syntax tree, with numbers and conditions apart."""

    def __init__(
        self,
        text: str,
        variables: tuple[str, ...],
        allow_infinite: bool,
        tables: Mapping[str, Table],
        numbers: Mapping[str, float],
    ) -> None:
        self.text = " ".join(text.split())
        self.variables = variables
        self.allow_infinite = allow_infinite
        infinity = {"inf": math.inf} if allow_infinite else {}
        self.constants = CONSTANTS | infinity | dict(numbers)
        self.tables = tables

    def expression(self, condition: bool) -> Expression:
        if not self.text:
            raise InputError("an empty text is neither a number nor an expression")
        if len(self.text) > MAX_LENGTH:
            raise InputError(
                f"the expression has {len(self.text)} characters; at most {MAX_LENGTH} are allowed"
            )
        if "#" in self.text or not self.text.isprintable():
            raise InputError(f"{shortened(self.text)!r} is not an expression")
        try:
            with warnings.catch_warnings():
                # Python warns of '1if x<0 else 2' and the like, which are valid here.
                warnings.simplefilter("ignore")
                tree = ast.parse(self.text, mode="eval")
        except SyntaxError as error:
            column = f" (at character {error.offset})" if error.offset else ""
            unit = "; a number has no unit" if _WITH_UNIT.fullmatch(self.text) else ""
            raise InputError(f"{self.shown()}: {error.msg}{column}{unit}") from None
        except (ValueError, RecursionError, MemoryError):
            raise InputError(f"{self.shown()}: it cannot be read as a formula") from None
        if condition:
            holds = self.condition(tree.body, 1)
            root = self.apply(tree.body, "if", holds, Number(1.0), Number(0.0))
        else:
            root = self.number(tree.body, 0)
        return Expression(self.text, self.allow_infinite, root)

    def number(self, node: ast.expr, depth: int) -> Node:
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
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
                a, b = self.number(left, below), self.number(right, below)
                exponent = b.value if isinstance(op, ast.Pow) and isinstance(b, Number) else 0.0
                if abs(exponent) > MAX_EXPONENT:
                    self.refuse(right, f"exponents are limited to {MAX_EXPONENT:g}")
                return self.apply(node, OPERATORS[type(op)], a, b)
            case ast.BinOp(op=ast.Mod()):
                self.refuse(node, f"there is no remainder %, only {_GRAMMAR}")
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
        self.refuse(node, f"only {_GRAMMAR}")

    def condition(self, node: ast.expr, depth: int) -> Node:
        self.check_depth(node, depth)
        below = depth + 1
        match node:
            case ast.Compare(left=left, ops=ops, comparators=others) if all(
                type(op) in OPERATORS for op in ops
            ):
                terms = [self.number(term, below) for term in (left, *others)]
                pairs = zip(ops, terms, terms[1:], strict=False)
                return reduce(
                    lambda a, b: Apply("and", (a, b)),
                    [Apply(OPERATORS[type(op)], (a, b)) for op, a, b in pairs],
                )
            case ast.BoolOp(op=op, values=values):
                operation = OPERATORS[type(op)]
                conditions = [self.condition(value, below) for value in values]
                return reduce(lambda a, b: Apply(operation, (a, b)), conditions)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return Apply("not", (self.condition(operand, below),))
        self.refuse(node, "expected a condition such as x < 0.5")

    def literal(self, node: ast.expr, value: float) -> Node:
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            self.refuse(node, "the number is too large")
        return Number(number)

    def name(self, node: ast.expr, name: str) -> Node:
        if name in self.variables:
            return Name(name)
        if name in self.constants:
            return Number(self.constants[name])
        if name in FUNCTIONS:
            self.refuse(node, f"the function {name} needs arguments in parentheses")
        known = [*self.variables, *self.constants]
        guess = nearest(name, known)
        self.refuse(node, f"unknown name '{name}'{guess}; known: {', '.join(known)}")

    def call(self, node: ast.expr, name: str, args: list[ast.expr], depth: int) -> Node:
        is_table = name not in FUNCTIONS and name in self.tables
        if name not in FUNCTIONS and not is_table:
            known = [*FUNCTIONS, *self.tables]
            guess = nearest(name, known)
            self.refuse(node, f"unknown function '{name}'{guess}; known: {', '.join(known)}")
        arity = 1 if is_table else FUNCTIONS[name]
        if (len(args) < 2) if arity is None else (len(args) != arity):
            demand = {None: "two or more arguments", 1: "1 argument", 2: "2 arguments"}[arity]
            self.refuse(node, f"{name} takes {demand}, not {len(args)}")
        arguments = [self.number(argument, depth) for argument in args]
        if is_table:
            return Lookup(self.tables[name], arguments[0])
        if arity is None:
            return reduce(lambda a, b: self.apply(node, name, a, b), arguments)
        return self.apply(node, name, *arguments)

    def apply(self, node: ast.expr, operation: str, *arguments: Node) -> Node:
        """The operation, evaluated at once if all arguments are numbers.

        UFL would evaluate it with Python's floats, for which 1/0 and sqrt(-1) are exceptions.
        """
        values = [argument.value for argument in arguments if isinstance(argument, Number)]
        if len(values) < len(arguments):
            return Apply(operation, arguments)
        with np.errstate(all="ignore"):
            value = float(NUMPY[operation](*values))
        if math.isnan(value) or (math.isinf(value) and not self.allow_infinite):
            self.refuse(node, f"the value is {value:g}")
        return Number(value)

    def check_depth(self, node: ast.expr, depth: int) -> None:
        if depth > MAX_DEPTH:
            self.refuse(node, f"more than {MAX_DEPTH} operations are nested")

    def refuse(self, node: ast.expr, reason: str) -> NoReturn:
        segment = ast.get_source_segment(self.text, node) or self.text
        # ast counts bytes, not characters.
        column = len(self.text.encode()[: node.col_offset].decode()) + 1
        place = "" if segment == self.text else f", at character {column} ('{shortened(segment)}')"
        raise InputError(f"{self.shown()}{place}: {reason}")

    def shown(self) -> str:
        return f"in the expression '{shortened(self.text)}'"
