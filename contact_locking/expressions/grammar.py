"""The whitelist of expressions: names, functions, operators and limits."""

from __future__ import annotations

import ast
import math

from contact_locking.arrays import LARGEST as LARGEST
from contact_locking.arrays import SMALLEST as SMALLEST

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
