"""The derivatives of quantities of a solution by numbers and by fields that it depends on.

The equations at an iterate that stands still are evaluated at two values around the present one:
the derivative of what they leave by a number is their central difference.  No solve takes part, so
that the difference has the accuracy of rounding to the power of two thirds, relative to data that
change on the scale of the value itself.

With l and y the adjoint of the quantity J by forces and by gaps of the points, its derivative by
all values of a function f of DOLFINx is that of

    Phi(f) = J(u; f) - a(u, l; f) + (f, l) + sum int y . gap(f),

in which the iterate stands still.  Where f is in the user's forms, one vector is assembled of the
derivative of Phi.  Moduli, limits and eigenstrains are values at the points of each cell, of which
Phi has a derivative as well.  They follow the values of f in the same cell: values that have no
cell in common are moved at a time, and what they move is told apart by the cells.

Data may read f in another way, as a displacement condition or a function of points does.  So the
derivative along a random direction is compared with a difference; where they disagree, each value
takes a difference of its own.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
import ufl
from dolfinx import fem, la

from contact_locking.arrays import BoolArray, FloatArray, IndexArray, IntArray
from contact_locking.errors import InputError
from contact_locking.fem.compiled import JointForm
from contact_locking.inverse.equations import Equations, Residual, require_solved
from contact_locking.inverse.linearisation import Adjoint, Change, Linearisation, nearer_the_path
from contact_locking.inverse.quantities import Quantity, quantity_of, scale_of
from contact_locking.parallel import maximum, on_any_rank
from contact_locking.problem import forms
from contact_locking.problem.discrete_problem import DiscreteProblem
from contact_locking.problem.system import System
from contact_locking.solver.interior_point.locking_cones import LimitsOfStrain
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


def number_of(number: Number) -> Put:
    """A number of a script."""
    return Put(number.name, number.value, partial(setattr, number, "value"))


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
        self, quantities: Sequence[Quantity], parameters: Sequence[Parameter], rates: FloatArray
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
            rates,
            rates * at / np.where(are_nothing, np.nan, values)[:, None],
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


# The difference along a direction agrees with a field to this share, or to this share of what
# quantities of the unit have.
_AGREES = 1e-5
# The width of the differences of data at points, relative to each value of the function.
_POINT_WIDTH = 1e-5


def field(made: Derivatives, name: str, of: fem.Function) -> fem.Function:
    """The derivatives of a quantity by the values of a function, in its space; collective."""
    comm, magnitudes = made.domain.comm, np.abs(of.x.array)
    # Each value has its own width of differences.
    sizes = np.where(magnitudes > 0.0, magnitudes, maximum(comm, magnitudes) or 1.0)
    first, end = (of.x.block_size * bound for bound in of.x.index_map.local_range)
    every, owned = range(of.x.block_size * of.x.index_map.size_global), slice(0, end - first)
    # All ranks draw the same direction.
    random = _with_owned(of, np.random.default_rng(0).uniform(0.5, 1.5, len(every))[first:end])
    direction = sizes * random.x.array
    along_direction = made.by(name, along(of, direction))
    noise = _NOTHING * scale_of(name, made.domain, made.frozen.system)
    for candidate in _by_forms(made, name, of, _POINT_WIDTH * sizes):
        gains = (candidate.x.array * direction)[owned]
        gain, most = comm.allreduce(np.array([gains.sum(), np.abs(gains).sum()]))
        if abs(gain - along_direction) <= _AGREES * most + noise:
            return candidate
    values = np.empty(end - first)
    for place in every:
        unit = _with_owned(of, (np.arange(first, end) == place).astype(float))
        value = made.by(name, along(of, sizes * unit.x.array))
        if first <= place < end:
            values[place - first] = value / sizes[place - first]
    return _with_owned(of, values)


def _with_owned(like: fem.Function, values: FloatArray) -> fem.Function:
    """A function in the space of another one with these owned values; collective."""
    function = fem.Function(like.function_space)
    function.x.array[: len(values)] = values
    function.x.scatter_forward()
    return function


def _by_forms(
    made: Derivatives, name: str, of: fem.Function, steps: FloatArray
) -> Iterator[fem.Function]:
    """The derivatives by the forms alone, and then with the values at points; collective."""
    problem, frozen = made.frozen.problem, made.frozen
    quantity, adjoint = made.adjoint(name)
    with frozen.system.preserved():
        frozen.equations().close()  # they put the displacement to the iterate
        equations, data, u = made.linear.equations, frozen.system.data, frozen.system.u
        test = frozen.system.function_of(adjoint.displacement)
        functional = forms.external_work(test, data) - forms.elastic_form(u, test, data)
        functional += quantity.functional(equations)
        result = _derivative(functional, of)
        yield result
        pairs = [
            (function, _derivative(functional, function).x.array)
            for function in _moved(problem, functional, of, steps)
        ]
        for family in equations.families:
            if isinstance(family, LimitsOfStrain):
                inverse = family.strains.law.inverse_limit
                gains = np.zeros_like(inverse.x.array)
                by_limit = np.atleast_2d(adjoint.gaps[family])[0]
                gains[family.strains.dofs] = -family.weights * by_limit * family.limit**2
                pairs.append((inverse, gains))
        result.x.array[:] += _through_points(problem, pairs, of, steps).x.array
        yield result


def _derivative(functional: ufl.Form, of: fem.Function) -> fem.Function:
    """The derivative of a functional by a function, as a function in its space; collective."""
    test, result = ufl.TestFunction(of.function_space), fem.Function(of.function_space)
    form = ufl.algorithms.expand_derivatives(ufl.derivative(functional, of, test))
    JointForm(form).assemble_vector(result.x)
    result.x.scatter_forward()
    return result


def _moved(
    problem: DiscreteProblem, functional: ufl.Form, of: fem.Function, steps: FloatArray
) -> list[fem.Function]:
    """The other functions in a functional that follow a function of the data; collective."""
    others = [function for function in functional.coefficients() if function is not of]
    before, start = [function.x.array.copy() for function in others], of.x.array.copy()
    of.x.array[:] += steps
    _read(problem)
    moved = [
        function
        for function, values in zip(others, before, strict=True)
        if on_any_rank(problem.domain.comm, function.x.array != values)
    ]
    of.x.array[:] = start
    _read(problem)
    return moved


def _read(problem: DiscreteProblem) -> None:
    """Take the present data at points; collective."""
    problem.material.refresh()
    problem.limits.refresh()


def _through_points(
    problem: DiscreteProblem,
    pairs: list[tuple[fem.Function, FloatArray]],
    of: fem.Function,
    steps: FloatArray,
) -> fem.Function:
    """The derivatives by a function of what gains by functions that follow it cell by cell.

    ``pairs`` are these functions and the gains by their values.  Collective.
    """
    result, size = fem.Function(of.function_space), of.x.block_size
    start, by_number = of.x.array.copy(), result.x.array.reshape(-1, size)
    dofs, local = _owned_cells(of), np.arange(len(by_number), dtype=np.int32)
    everywhere = of.x.index_map.local_to_global(local)
    numbers = everywhere[dofs]
    for apart in _sets_apart(np.vstack(problem.domain.comm.allgather(numbers))):
        cells, columns = np.nonzero(apart[numbers])
        places = dofs[cells, columns]
        for component in range(size):
            moved = np.zeros_like(steps).reshape(-1, size)
            moved[apart[everywhere], component] = 1.0
            sides = []
            for sign in (1.0, -1.0):
                of.x.array[:] = start + sign * moved.reshape(-1) * steps
                _read(problem)
                sides.append([function.x.array.copy() for function, _ in pairs])
            gained = np.zeros(len(dofs))
            for (function, gains), above, below in zip(pairs, *sides, strict=True):
                by_block = (gains * (above - below)).reshape(-1, function.x.block_size).sum(axis=1)
                gained += by_block[_owned_cells(function)].sum(axis=1)
            widths = 2.0 * steps.reshape(-1, size)[places, component]
            np.add.at(by_number[:, component], places, gained[cells] / widths)
    of.x.array[:] = start
    _read(problem)
    result.x.scatter_reverse(la.InsertMode.add)
    result.x.scatter_forward()
    return result


def _owned_cells(of: fem.Function) -> IndexArray:
    """The places of values, in blocks, in each cell of this rank."""
    topology = of.function_space.mesh.topology
    return of.function_space.dofmap.list[: topology.index_map(topology.dim).size_local]


def _sets_apart(cells: IntArray) -> Iterator[BoolArray]:
    """Sets of numbers, of which no two are in one row, that have each number once."""
    count = int(cells.max(initial=-1)) + 1
    order, remaining = np.random.default_rng(0).permutation(count), np.ones(count, dtype=bool)
    while remaining.any():
        chosen, free = np.zeros(count, dtype=bool), remaining.copy()
        while free.any():
            # A number is chosen that comes before all others in its rows.
            ranks = np.where(free, order, -1)[cells]
            beaten = np.zeros(count, dtype=bool)
            beaten[cells[ranks < ranks.max(axis=1, keepdims=True)]] = True
            new = free & ~beaten
            chosen |= new
            free &= ~new
            free[cells[new[cells].any(axis=1)]] = False
        remaining &= ~chosen
        yield chosen
