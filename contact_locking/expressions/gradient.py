"""Values and exact gradients of expressions, by the chain rule from the leaves to the root."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from contact_locking.arrays import FloatArray

from .operations import NUMPY
from .tree import Apply, Expression, Lookup, Name, Node, Number

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
                condition, (_, one), (_, other) = values[0], *parts[1:]
                names = one.keys() | other.keys()
                chosen = {
                    name: np.where(condition, one.get(name, 0.0), other.get(name, 0.0))
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
