"""Numbers that a problem depends on, and its equations at other values of them.

The equations at an iterate that stands still are evaluated at two values around the present one:
the derivative of what they leave by a number is their central difference.  No solve takes part, so
that the difference has the accuracy of rounding to the power of two thirds, relative to data that
change on the scale of the value itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.problem.discrete_problem import DiscreteProblem
from contact_locking.problem.system import PenalisedSystem
from contact_locking.sensitivity.equations import Equations
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

    def equations_at(self, value: float, frozen: Frozen) -> AbstractContextManager[Equations]:
        """A context with the equations for another value; collective."""
        return _between(partial(setattr, self, "value"), value, self.value, frozen)


@dataclass(frozen=True)
class Entry:
    """An entry of a constant of DOLFINx; ``place`` is the index in its flat values."""

    constant: fem.Constant
    place: int
    name: str

    @property
    def value(self) -> float:
        """The present value."""
        return float(np.ravel(self.constant.value)[self.place])

    def equations_at(self, value: float, frozen: Frozen) -> AbstractContextManager[Equations]:
        """A context with the equations for another value; collective."""
        before = np.array(self.constant.value)
        other = before.copy()
        other.reshape(-1)[self.place] = value
        return _between(partial(setattr, self.constant, "value"), other, before, frozen)


@dataclass(frozen=True)
class Along:
    """The share of a direction that is added to a function of DOLFINx, counted from ``value``.

    ``direction`` has the local values, ghosts included, of the size of those of the function.
    """

    function: fem.Function
    direction: FloatArray
    value: float = 1.0

    @property
    def name(self) -> str:
        """The name in tables."""
        return str(self.function.name)

    def equations_at(self, value: float, frozen: Frozen) -> AbstractContextManager[Equations]:
        """A context with the equations for another value; collective."""
        values = self.function.x.array
        before, more = values.copy(), (value - self.value) * self.direction
        return _between(partial(np.copyto, values), before + more, before, frozen)


@contextmanager
def _between(
    put: Callable[[Any], None], value: Any, before: Any, frozen: Frozen
) -> Iterator[Equations]:
    """The equations of a problem while its data have another value; collective."""
    put(value)
    try:
        frozen.refresh()
        equations = frozen.equations()
        try:
            yield equations
        finally:
            equations.destroy()
    finally:
        put(before)
        frozen.refresh()


def width(parameter: Parameter, scale: float) -> float:
    """The distance of the two values; ``scale`` stands for a value of zero."""
    return _WIDTH * (abs(parameter.value) or scale)
