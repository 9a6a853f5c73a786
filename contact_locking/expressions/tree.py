"""Expressions as trees, and their values in NumPy and in UFL."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from contact_locking.errors import InputError

from .grammar import LARGEST, shortened
from .operations import NUMPY, ufl_operations


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


Node = Number | Name | Apply


def _evaluate(
    node: Node, operations: Mapping[str, Callable[..., Any]], variables: Mapping[str, Any]
) -> Any:
    match node:
        case Number(value):
            return value
        case Name(name):
            return variables[name]
        case Apply(operation, arguments):
            values = [_evaluate(argument, operations, variables) for argument in arguments]
            return operations[operation](*values)


@dataclass(frozen=True)
class Expression:
    """A number or a formula in named variables, made by `parse`."""

    text: str
    names: frozenset[str]
    allow_infinite: bool
    root: Node

    @property
    def is_constant(self) -> bool:
        """Whether the expression has no variables."""
        return not self.names

    def numpy(self, **variables: npt.ArrayLike) -> Any:
        """The values at the given points: an array of the broadcast shape of the variables.

        The value is a float if all variables are numbers, or none is given. Variables that do not
        occur in the expression contribute only their shape. Raises InputError if a value is not a
        number, is infinite (plus infinity passes with ``allow_infinite``) or exceeds `LARGEST`.
        """
        self._require(variables)
        arrays = {name: np.asarray(value, dtype=float) for name, value in variables.items()}
        shape = np.broadcast_shapes(*(array.shape for array in arrays.values()))
        with np.errstate(all="ignore"):
            value = _evaluate(self.root, NUMPY, arrays)
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
                f"the expression '{shortened(self.text)}' is {values[first]:g}"
                f"{f' at {place}' if place else ''}; it has to be a finite number"
                f"{f' of at most {LARGEST:g}' if np.isfinite(values[first]) else ''}"
            )
        return values if shape else float(values)

    def ufl(self, **variables: Any) -> Any:
        """The expression in UFL, with UFL scalars for the variables; a float for a constant.

        Raises InputError if UFL finds that the expression is defined nowhere, such as ``1/(0*x)``.
        """
        self._require(variables)
        if self.is_constant:
            return self.numpy()
        try:
            return _evaluate(self.root, ufl_operations(), variables)
        except (ArithmeticError, ValueError) as error:
            raise InputError(
                f"the expression '{shortened(self.text)}' is not defined: {error}"
            ) from error

    def _require(self, variables: Mapping[str, Any]) -> None:
        if missing := self.names - variables.keys():
            raise TypeError(
                f"'{shortened(self.text)}' needs a value of {', '.join(sorted(missing))}"
            )
