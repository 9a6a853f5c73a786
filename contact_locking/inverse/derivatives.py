"""The derivatives of quantities of a solution by the numbers that it depends on.

The equations at an iterate that stands still are evaluated at two values around the present one:
the derivative of what they leave by a number is their central difference.  No solve takes part, so
that the difference has the accuracy of rounding to the power of two thirds, relative to data that
change on the scale of the value itself.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from dolfinx import fem

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.errors import InputError
from contact_locking.inverse.equations import Equations, Residual, require_solved
from contact_locking.inverse.linearisation import Adjoint, Change, Linearisation, nearer_the_path
from contact_locking.inverse.quantities import Quantity, quantity_of, scale_of
from contact_locking.problem.discrete_problem import DiscreteProblem
from contact_locking.problem.system import System
from contact_locking.solver.task import SavedState, Target, Task

# The width of central differences over the value: the cube root of the rounding.
_WIDTH = float(np.cbrt(np.finfo(float).eps))


@dataclass(frozen=True)
class Frozen:
    """A problem with its solver's system, at the last iterate; ``target`` gives present scales."""

    problem: DiscreteProblem
    system: System
    target: Callable[[], Target]
    iterate: SavedState

    def equations(self) -> Equations:
        """The equations for the present data; collective."""
        return Equations(self.system, self.target(), self.iterate)


def refresh(problem: DiscreteProblem, system: System) -> None:
    """Take the present data of a problem; collective."""
    problem.refresh()
    system.assemble_loads()


class Parameter(Protocol):
    """A number, at present ``value``, that the equations depend on smoothly, with its name."""

    @property
    def name(self) -> str: ...
    @property
    def value(self) -> float: ...
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
            refresh(frozen.problem, frozen.system)
            with closing(frozen.equations()) as equations:
                yield equations
        finally:
            self.put(self.value)
            refresh(frozen.problem, frozen.system)


def number_of(given: Number) -> Put:
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


# A quantity below this share of its scale is nothing: gaps leave as much, and rounding less.
_NOTHING = 1e-8
# So many steps to the central path; two are usual.
_MOST_STEPS = 5


@dataclass(frozen=True)
class Table:
    """Values (m,) of m quantities, derivatives (m, n) by n parameters, and ``elasticities``.

    The last are ``d ln J/d ln p`` (m, n), not a number where J is nothing.  ``are_nothing`` (m,)
    says which quantities are zero, or as good as that.
    """

    quantities: tuple[str, ...]
    parameters: tuple[str, ...]
    values: FloatArray
    derivatives: FloatArray
    elasticities: FloatArray
    are_nothing: BoolArray


class Derivatives:
    """The derivatives at one solution; the tangent is factorised at the first use.

    ``frozen`` is the problem at the last iterate, and ``linear`` its tangent.
    With n parameters and m quantities there are ``min(m, n)`` solves with the tangent, and with
    friction some more for each.  Collective, as all methods are.  Raises InputError if the data
    have changed since the solve, or if no derivative is known.
    """

    def __init__(self, frozen: Frozen, task: Task) -> None:
        self.frozen, self._adjoints = frozen, dict[str, tuple[Quantity, Adjoint]]()
        self.domain = domain = frozen.problem.domain
        self._scale = domain.extent
        with frozen.system.preserved():
            equations = frozen.equations()
            try:
                require_solved(equations)
            except InputError:
                equations.close()
                raise
            self.linear = Linearisation(equations, task)
            for _ in range(_MOST_STEPS):
                iterate = nearer_the_path(self.linear)
                if iterate is None:
                    break
                self.destroy()
                self.frozen = dataclasses.replace(self.frozen, iterate=iterate)
                self.linear = Linearisation(self.frozen.equations(), task)

    def forward(
        self, names: Sequence[str], parameters: Sequence[Parameter]
    ) -> tuple[Table, list[Change]]:
        """All derivatives, and how the iterate changes with each parameter."""
        with self.frozen.system.preserved():
            quantities = self.quantities(names)
            changes, columns = [], []
            gradients = [quantity.gradient(self.linear.equations) for quantity in quantities]
            for parameter in parameters:
                rate = self.rate(parameter, quantities)
                change = self.linear.change(rate)
                gained = [self.linear.paired(gradient, change) for gradient in gradients]
                changes.append(change)
                columns.append(rate.values + gained)
            return self._table(quantities, parameters, np.array(columns).T), changes

    def table(self, names: Sequence[str], parameters: Sequence[Parameter]) -> Table:
        """All derivatives, by the fewer solves: a parameter or a quantity each."""
        if len(parameters) <= len(names):
            return self.forward(names, parameters)[0]
        with self.frozen.system.preserved():
            pairs = [self.adjoint(name) for name in names]
            quantities = [quantity for quantity, _ in pairs]
            columns = [
                [
                    rate.values[row] + self.linear.gained(adjoint, rate)
                    for row, (_, adjoint) in enumerate(pairs)
                ]
                for rate in (self.rate(parameter, quantities) for parameter in parameters)
            ]
            return self._table(quantities, parameters, np.array(columns).T)

    def _table(
        self, quantities: Sequence[Quantity], parameters: Sequence[Parameter], found: FloatArray
    ) -> Table:
        values = evaluated(self.linear.equations, quantities).values
        system = self.frozen.system
        scales = [scale_of(quantity.name, self.domain, system) for quantity in quantities]
        are_nothing = np.abs(values) <= _NOTHING * np.array(scales)
        at = np.array([parameter.value for parameter in parameters])
        return Table(
            tuple(quantity.name for quantity in quantities),
            tuple(parameter.name for parameter in parameters),
            values,
            found,
            found * at / np.where(are_nothing, np.nan, values)[:, None],
            are_nothing,
        )

    def by(self, name: str, parameter: Parameter) -> float:
        """The derivative of one quantity, whose adjoint is kept."""
        with self.frozen.system.preserved():
            quantity, adjoint = self.adjoint(name)
            rate = self.rate(parameter, [quantity])
            return float(rate.values[0]) + self.linear.gained(adjoint, rate)

    def adjoint(self, name: str) -> tuple[Quantity, Adjoint]:
        """The quantity with a name and its adjoint, which is found once."""
        if name not in self._adjoints:
            (quantity,) = self.quantities([name])
            gradient = quantity.gradient(self.linear.equations)
            self._adjoints[name] = quantity, self.linear.adjoint(gradient)
        return self._adjoints[name]

    def quantities(self, names: Sequence[str]) -> list[Quantity]:
        """The quantities by their names."""
        equations = self.linear.equations
        return [quantity_of(name, self.domain, equations.system).at(equations) for name in names]

    def rate(self, parameter: Parameter, quantities: Sequence[Quantity]) -> Residual:
        """The change of the residual, and of the quantities themselves, by a parameter."""
        step, value = width(parameter, self._scale), parameter.value
        with parameter.equations_at(value + step, self.frozen) as after:
            above = evaluated(after, quantities)
        with parameter.equations_at(value - step, self.frozen) as before:
            below = evaluated(before, quantities)
        # The sum of the value and the step has rounding of its own.
        return above.per(below, (value + step) - (value - step))

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self.linear.destroy()


def evaluated(equations: Equations, quantities: Sequence[Quantity]) -> Residual:
    """The residual of the equations, with the values of quantities; collective."""
    residual = equations.residual()
    values = [quantity.value(equations, residual) for quantity in quantities]
    return dataclasses.replace(residual, values=np.array(values))
