"""The present values of data: at points, and in UFL."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import AXES, FloatArray
from contact_locking.errors import InputError, with_key
from contact_locking.expressions import TIME, Lookup
from contact_locking.mesh.cell_kind import lagrange, nodal_functions
from contact_locking.parallel import agree, maximum
from contact_locking.values.value import Value

_ROUNDING = 1e-12
# Data are sampled at so many times of a process, the first and the last among them.
_TIMES = 8
_UP_TO_ONE = [number / _TIMES for number in range(_TIMES + 1)]
# By the number of corners.
_SIMPLICES = {2: "interval", 3: "triangle", 4: "tetrahedron"}


class Clock:
    """The time t on a mesh: ``now`` for values at points, ``constant`` for the forms.

    ``planned`` are the times of a process, which begins at 0 or at the first of them.
    ``some_times`` are some of these at which data are sampled, and times up to t = 1 where a script
    tells the times of its steps later.
    """

    def __init__(self, mesh: dolfinx.mesh.Mesh, planned: Sequence[float] = ()) -> None:
        self.mesh, self.planned = mesh, tuple(planned)
        first = float(planned[0]) if planned else 0.0
        places = np.linspace(0, len(planned) - 1, min(len(planned), _TIMES))
        self.some_times = [planned[round(place)] for place in places] or _UP_TO_ONE
        self.constant = fem.Constant(mesh, first)

    @property
    def now(self) -> float:
        return float(self.constant.value)

    def set(self, time: float) -> None:
        self.constant.value = time


class LargestSoFar:
    """The largest size that a quantity has had at any time so far.

    A size below 1e-12 of the largest is zero with rounding, as that of sin(pi*t) is at t = 1.
    """

    def __init__(self) -> None:
        self._most = 0.0

    def hides(self, size: float) -> bool:
        """Whether the present ``size`` >= 0, which counts from now on, is zero with rounding."""
        self._most = max(self._most, size)
        return size <= _ROUNDING * self._most < np.inf


class PresentValue:
    """A value on the mesh of a clock, at its time.

    ``key`` names it in messages.  Calls give the values (k, ...) of the ``shape`` at points (d, k);
    those that are small beside those of earlier times are zero with rounding, and then all are
    zero.  All methods are collective.  The constructor raises InputError for a coordinate that the
    mesh does not have, and a call for a value that is no number.
    """

    def __init__(self, value: Value, key: str, clock: Clock, shape: tuple[int, ...] = ()) -> None:
        self.value, self.key, self.clock, self._shape = value, key, clock, shape
        self._so_far = LargestSoFar()
        # What stands for a table, or for a function of points, in UFL.
        self._coefficients: dict[Any, fem.Constant | fem.Function] = {}
        self._degree = 1
        names = frozenset[str]() if value.expression is None else value.expression.names
        for unknown in names.intersection(AXES[clock.mesh.geometry.dim :]):
            raise InputError(f"unknown name '{unknown}' in the expression '{value}'", key)

    def __call__(self, x: FloatArray) -> FloatArray:
        comm = self.clock.mesh.comm

        def values() -> FloatArray:
            found = self.value.at(x, self.clock.now, self._shape)
            if np.isnan(found).any():
                raise InputError("is not a number somewhere")
            return found

        found = agree(comm, lambda: with_key(self.key, values))
        is_zero = self.value.is_timed and self._so_far.hides(maximum(comm, np.abs(found)))
        return np.zeros_like(found) if is_zero else found

    def ufl(self, degree: int) -> Expr:
        """The value in UFL.

        A table over coordinates, and a function of points, count by their values at the nodes of
        the ``degree``; see :meth:`refresh`.
        """
        value, mesh = self.value, self.clock.mesh
        if value.number is not None:
            return fem.Constant(mesh, value.number)
        self._degree = degree
        if value.expression is None:
            data = getattr(value.data, "ufl", value.data)
            if not isinstance(data, Expr):
                data = self._coefficients[value] = self._nodal()
                self.refresh()
            return data
        x = ufl.SpatialCoordinate(mesh)
        places: dict[str, Any] = {axis: x[i] for i, axis in enumerate(AXES[: mesh.geometry.dim])}
        for table in value.expression.lookups:
            is_number = table.names <= {TIME}
            self._coefficients[table] = fem.Constant(mesh, 0.0) if is_number else self._nodal()
        self.refresh()
        places[TIME] = self.clock.constant
        return value.expression.ufl(self._coefficients, **places)

    def refresh(self) -> None:
        """Put what stands for tables and functions in UFL to the present time.

        The nodal values outside of a table are those of its end: a cell on the boundary has nodes
        where a load does not act.
        """
        now = self.clock.now
        for data, coefficient in self._coefficients.items():
            if isinstance(coefficient, fem.Constant):
                coefficient.value = data.clamped(**{TIME: now})
            else:
                coefficient.interpolate(partial(self._at, data, time=now))

    @property
    def is_nodal(self) -> bool:
        """Whether a table counts by its values at nodes in UFL."""
        return any(isinstance(item, fem.Function) for item in self._coefficients.values())

    def in_simplices(
        self, corners: FloatArray, shares: FloatArray, time: float
    ) -> dict[Lookup, FloatArray]:
        """The values (m * q,) of tables in UFL at points of m simplices with corners (m, c, d).

        ``shares`` (q, c) are the barycentric coordinates of the points.
        """
        cell = _SIMPLICES[shares.shape[1]]
        places = lagrange(cell, self._degree).points
        at_nodes = np.column_stack([1.0 - places.sum(axis=1), places])
        nodes = np.einsum("nc,mcd->dmn", at_nodes, corners)
        basis = nodal_functions(cell, self._degree, shares[:, 1:])
        return {
            table: np.einsum("qn,mn->mq", basis, self._at(table, nodes, time)).reshape(-1)
            for table, coefficient in self._coefficients.items()
            if isinstance(coefficient, fem.Function)
        }

    def _nodal(self) -> fem.Function:
        return fem.Function(fem.functionspace(self.clock.mesh, ("P", self._degree)))

    def _at(self, data: Value | Lookup, x: FloatArray, time: float) -> FloatArray:
        if isinstance(data, Value):
            return data.at(x[: self.clock.mesh.geometry.dim], time)
        places: dict[str, Any] = dict(zip(AXES, x, strict=False))
        return data.clamped(**places, **{TIME: time}) + 0.0 * x[0]
