"""The whitelist of expressions, and its operations in NumPy and in UFL."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

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
