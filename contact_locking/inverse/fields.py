"""The derivatives of a quantity by all values of a function of DOLFINx.

With l and y the adjoint of the quantity J by forces and by gaps of the points, its derivative by a
function f of the data is that of

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

from collections.abc import Iterator

import numpy as np
import ufl
from dolfinx import fem, la

from contact_locking.arrays import BoolArray, FloatArray, IndexArray, IntArray
from contact_locking.fem.compiled import JointForm
from contact_locking.inverse.derivatives import Derivatives, along
from contact_locking.inverse.quantities import scale_of
from contact_locking.parallel import maximum, on_any_rank
from contact_locking.problem import forms
from contact_locking.problem.discrete_problem import DiscreteProblem
from contact_locking.solver.interior_point.locking_cones import LimitsOfStrain

# The difference along a direction agrees with a field to this share, or to this share of what
# quantities of the unit have.
_AGREES, _NOTHING = 1e-5, 1e-8
# The width of the differences of data at points, relative to each value of the function.
_WIDTH = 1e-5


def field(made: Derivatives, name: str, of: fem.Function) -> fem.Function:
    """The derivatives of a quantity by the values of a function, in its space; collective."""
    comm, given = made.domain.comm, np.abs(of.x.array)
    # Each value has its own width of differences.
    sizes = np.where(given > 0.0, given, maximum(comm, given) or 1.0)
    first, end = (of.x.block_size * bound for bound in of.x.index_map.local_range)
    every, own = range(of.x.block_size * of.x.index_map.size_global), slice(0, end - first)
    # All ranks draw the same direction.
    random = _with_owned(of, np.random.default_rng(0).uniform(0.5, 1.5, len(every))[first:end])
    direction = sizes * random.x.array
    wanted = made.by(name, along(of, direction))
    noise = _NOTHING * scale_of(name, made.domain, made.frozen.system)
    for found in _by_forms(made, name, of, _WIDTH * sizes):
        gains = (found.x.array * direction)[own]
        gain, most = comm.allreduce(np.array([gains.sum(), np.abs(gains).sum()]))
        if abs(gain - wanted) <= _AGREES * most + noise:
            return found
    values = np.empty(end - first)
    for place in every:
        unit = _with_owned(of, (np.arange(first, end) == place).astype(float))
        value = made.by(name, along(of, sizes * unit.x.array))
        if first <= place < end:
            values[place - first] = value / sizes[place - first]
    return _with_owned(of, values)


def _with_owned(like: fem.Function, values: FloatArray) -> fem.Function:
    """A function in the space of another one with these owned values; collective."""
    found = fem.Function(like.function_space)
    found.x.array[: len(values)] = values
    found.x.scatter_forward()
    return found


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
        found = _derivative(functional, of)
        yield found
        pairs = [
            (one, _derivative(functional, one).x.array)
            for one in _moved(problem, functional, of, steps)
        ]
        for family in equations.families:
            if isinstance(family, LimitsOfStrain):
                inverse = family.strains.law.inverse_limit
                gains = np.zeros_like(inverse.x.array)
                by_limit = np.atleast_2d(adjoint.gaps[family])[0]
                gains[family.strains.dofs] = -family.weights * by_limit * family.limit**2
                pairs.append((inverse, gains))
        found.x.array[:] += _through_points(problem, pairs, of, steps).x.array
        yield found


def _derivative(functional: ufl.Form, of: fem.Function) -> fem.Function:
    """The derivative of a functional by a function, as a function in its space; collective."""
    test, found = ufl.TestFunction(of.function_space), fem.Function(of.function_space)
    form = ufl.algorithms.expand_derivatives(ufl.derivative(functional, of, test))
    JointForm(form).assemble_vector(found.x)
    found.x.scatter_forward()
    return found


def _moved(
    problem: DiscreteProblem, functional: ufl.Form, of: fem.Function, steps: FloatArray
) -> list[fem.Function]:
    """The other functions in a functional that follow a function of the data; collective."""
    others = [one for one in functional.coefficients() if one is not of]
    before, given = [one.x.array.copy() for one in others], of.x.array.copy()
    of.x.array[:] += steps
    _read(problem)
    moved = [
        one
        for one, values in zip(others, before, strict=True)
        if on_any_rank(problem.domain.comm, one.x.array != values)
    ]
    of.x.array[:] = given
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
    found, size = fem.Function(of.function_space), of.x.block_size
    given, by_number = of.x.array.copy(), found.x.array.reshape(-1, size)
    dofs, here = _owned_cells(of), np.arange(len(by_number), dtype=np.int32)
    everywhere = of.x.index_map.local_to_global(here)
    numbers = everywhere[dofs]
    for apart in _sets_apart(np.vstack(problem.domain.comm.allgather(numbers))):
        cells, columns = np.nonzero(apart[numbers])
        places = dofs[cells, columns]
        for component in range(size):
            moved = np.zeros_like(steps).reshape(-1, size)
            moved[apart[everywhere], component] = 1.0
            sides = []
            for sign in (1.0, -1.0):
                of.x.array[:] = given + sign * moved.reshape(-1) * steps
                _read(problem)
                sides.append([one.x.array.copy() for one, _ in pairs])
            gained = np.zeros(len(dofs))
            for (one, gains), above, below in zip(pairs, *sides, strict=True):
                by_block = (gains * (above - below)).reshape(-1, one.x.block_size).sum(axis=1)
                gained += by_block[_owned_cells(one)].sum(axis=1)
            widths = 2.0 * steps.reshape(-1, size)[places, component]
            np.add.at(by_number[:, component], places, gained[cells] / widths)
    of.x.array[:] = given
    _read(problem)
    found.x.scatter_reverse(la.InsertMode.add)
    found.x.scatter_forward()
    return found


def _owned_cells(of: fem.Function) -> IndexArray:
    """The places of values, in blocks, in each cell of this rank."""
    topology = of.function_space.mesh.topology
    return of.function_space.dofmap.list[: topology.index_map(topology.dim).size_local]


def _sets_apart(cells: IntArray) -> Iterator[BoolArray]:
    """Sets of numbers, of which no two are in one row, that have each number once."""
    count = int(cells.max(initial=-1)) + 1
    order, left = np.random.default_rng(0).permutation(count), np.ones(count, dtype=bool)
    while left.any():
        chosen, free = np.zeros(count, dtype=bool), left.copy()
        while free.any():
            # A number is chosen that comes before all others in its rows.
            ranks = np.where(free, order, -1)[cells]
            beaten = np.zeros(count, dtype=bool)
            beaten[cells[ranks < ranks.max(axis=1, keepdims=True)]] = True
            new = free & ~beaten
            chosen |= new
            free &= ~new
            free[cells[new[cells].any(axis=1)]] = False
        left &= ~chosen
        yield chosen
