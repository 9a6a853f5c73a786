"""Numbers that a problem depends on, and its equations at other values of them.

The equations at an iterate that stands still are evaluated at two values around the present one:
the derivative of what they leave by a number is their central difference.  No solve takes part, so
that the difference has the accuracy of rounding to the power of two thirds, relative to data that
change on the scale of the value itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.inverse.equations import Equations
from contact_locking.problem.discrete_problem import DiscreteProblem
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.task import LastIterate, Target

# The width of central differences over the value: the cube root of the rounding.
_WIDTH = float(np.cbrt(np.finfo(float).eps))


@dataclass(frozen=True)
class Frozen:
    """A problem with its solver's system, at the last iterate; ``target`` gives present scales."""

    problem: DiscreteProblem
    system: PenalisedSystem
    target: Callable[[], Target]
    iterate: LastIterate

    def equations(self) -> Equations:
        """The equations for the present data; collective."""
        return Equations(self.system, self.target(), self.iterate)

    def refresh(self) -> None:
        """Take the present data; collective."""
        refresh(self.problem, self.system)


def refresh(problem: DiscreteProblem, system: PenalisedSystem) -> None:
    """Take the present data of a problem; collective."""
    problem.refresh()
    system.assemble_loads()


class Parameter(Protocol):
    """A number that the equations depend on smoothly."""

    @property
    def name(self) -> str:
        """The name in tables."""

    @property
    def value(self) -> float:
        """The present value."""

    def equations_at(self, value: float, frozen: Frozen) -> AbstractContextManager[Equations]:
        """A context with the equations for another value; collective."""


@dataclass
class Number:
    """A number of a script by its ``name``, which functions of its data read as ``value``.

    The functions are those that each solve calls: of points, of slips, or of a motion.
    """

    value: float
    name: str = "number"


@dataclass(frozen=True)
class Put:
    """A number that ``put`` gives to the data of a problem, at present ``value``."""

    name: str
    value: float
    put: Callable[[float], None]

    @contextmanager
    def equations_at(self, value: float, frozen: Frozen) -> Iterator[Equations]:
        """A context with the equations for another value; collective."""
        self.put(value)
        try:
            frozen.refresh()
            with closing(frozen.equations()) as equations:
                yield equations
        finally:
            self.put(self.value)
            frozen.refresh()


def number(given: Number) -> Put:
    """A number of a script."""
    return Put(given.name, given.value, partial(setattr, given, "value"))


def entries(constant: fem.Constant) -> list[Put]:
    """The entries of a constant of DOLFINx, in the order of its flat values."""
    flat = np.reshape(constant.value, -1)
    return [Put(f"{at}", float(flat[at]), partial(flat.__setitem__, at)) for at in range(len(flat))]


def along(function: fem.Function, direction: FloatArray) -> Put:
    """The share, at present 1, of a direction in a function of DOLFINx.

    ``direction`` has the local values, ghosts included, of the size of those of the function.
    """
    values, before = function.x.array, function.x.array.copy()

    def put(share: float) -> None:
        values[:] = before + (share - 1.0) * direction

    return Put(str(function.name), 1.0, put)


def width(parameter: Parameter, scale: float) -> float:
    """The distance of the two values; ``scale`` stands for a value of zero."""
    return _WIDTH * (abs(parameter.value) or scale)
