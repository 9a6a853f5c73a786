"""The points of the strains in all cells, and the values of data there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.fem import compiled
from contact_locking.fem.spaces import Element
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import minimum

#: A number, a constant or function of DOLFINx, an expression of UFL, or a function of points
#: (d, k) with values (k, ...); or an object whose method ``at`` gives the values at `Points`.
Value = Any


class Points:
    """The points of the strains in all local cells, numbered cell by cell.

    ``places`` (d, k) are the coordinates of the points, ``dofs`` (k,) are the degrees of freedom of
    the points in ``space``, and ``all`` (k,) are the numbers of the points.
    """

    def __init__(self, domain: Domain, element: Element) -> None:
        self.domain, self.element = domain, element
        self.places = element.strain_places(domain.mesh)
        self.all = np.arange(self.places.shape[1], dtype=np.int32)
        self.space = element.strain_space(domain.mesh)
        self.in_cell = self.space.dofmap.list.shape[1]
        self.dofs = self.space.dofmap.list.reshape(-1)

    def of(self, cells: IndexArray) -> IndexArray:
        """The numbers of the points in the given cells."""
        return self.all.reshape(-1, self.in_cell)[cells].reshape(-1)

    def function(self, shape: tuple[int, ...] = ()) -> fem.Function:
        """A function in the space of strains, with values of the given shape; collective."""
        space = self.element.strain_space(self.space.mesh, shape) if shape else self.space
        return fem.Function(space)

    def write(self, function: fem.Function, values: FloatArray) -> None:
        """Give a function of the space of strains the values (k, ...) at the points."""
        dofs = function.function_space.dofmap.list.reshape(-1)
        function.x.array.reshape(-1, *function.ufl_shape)[dofs] = values

    def values(self, function: fem.Function) -> FloatArray:
        """The values (k, ...) of a function of the space of strains."""
        dofs = function.function_space.dofmap.list.reshape(-1)
        return np.asarray(function.x.array.reshape(-1, *function.ufl_shape)[dofs])

    def sampler(self, value: Value, key: str, shape: tuple[int, ...] = ()) -> Sampler:
        """A function that returns the present values (k, ...) of data at the points.

        Their evaluation is compiled once.  The function raises InputError with the
        key for a value that is not a number; both are collective.
        """
        count = len(self.all)

        def full(values: Any) -> FloatArray:
            return np.broadcast_to(np.asarray(values, dtype=float), (count, *shape)).copy()

        if hasattr(value, "at"):
            return lambda: value.at(self)
        if isinstance(value, fem.Constant):
            return lambda: self._checked(full(value.value), key)
        if isinstance(value, Expr):
            if value.ufl_shape != shape:
                raise InputError(f"has the shape {value.ufl_shape}; it must be {shape}", key)
            function = self.function(shape)
            expression = compiled.interpolation(value, function.function_space)

            def interpolated() -> FloatArray:
                function.interpolate(expression)
                return self._checked(self.values(function), key)

            return interpolated
        if callable(value):
            return lambda: self._checked(full(value(self.places)), key)
        fixed = full(value)
        return lambda: self._checked(fixed, key)

    def _checked(self, values: FloatArray, key: str) -> FloatArray:
        """The values; raises InputError if one of any rank is not a number; collective."""
        if minimum(self.domain.comm, np.where(np.isnan(values), -1.0, 1.0)) < 0.0:
            raise InputError("is not a number somewhere in the body", key)
        return values


Sampler = Callable[[], FloatArray]


def least(domain: Domain, values: FloatArray) -> float:
    """The minimum over all ranks; NaN counts as -inf; collective."""
    return minimum(domain.comm, np.where(np.isnan(values), -np.inf, values))
