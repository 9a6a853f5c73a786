"""The values of tables in the forms of loads."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any

import dolfinx
import numpy as np
from dolfinx import fem

from contact_locking.arrays import AXES, FloatArray
from contact_locking.expressions import TIME, Expression, Lookup
from contact_locking.fields.clock import Clock
from contact_locking.mesh.lagrange import lagrange, nodal_functions

# By the number of corners.
_SIMPLICES = {2: "interval", 3: "triangle", 4: "tetrahedron"}


class Lookups:
    """The tables of expressions as coefficients: a number over t, a field over a coordinate.

    A field has the values of the table at the nodes of the given degree.
    """

    def __init__(
        self,
        mesh: dolfinx.mesh.Mesh,
        expressions: Iterable[Expression],
        degree: int,
        clock: Clock,
    ) -> None:
        self._clock, self._degree = clock, degree
        #: The coefficients in UFL.
        self.coefficients: dict[Lookup, Any] = {}
        space: fem.FunctionSpace | None = None
        #: The tables that are fields.
        self.fields: list[Lookup] = []
        for lookup in (item for expression in expressions for item in expression.lookups):
            if lookup.names <= {TIME}:
                self.coefficients[lookup] = fem.Constant(mesh, 0.0)
            elif lookup not in self.coefficients:
                self.fields.append(lookup)
                space = space or fem.functionspace(mesh, ("P", degree))
                self.coefficients[lookup] = fem.Function(space)
        self.refresh()

    def refresh(self) -> None:
        """Evaluate the tables at the present time; collective.

        The nodal values outside of a table are those of its end: a cell on the boundary has nodes
        where the load does not act.
        """
        for lookup, coefficient in self.coefficients.items():
            if isinstance(coefficient, fem.Constant):
                coefficient.value = lookup.clamped(**{TIME: self._clock.now})
            else:
                coefficient.interpolate(partial(self._at, lookup, time=self._clock.now))

    def in_simplices(
        self, corners: FloatArray, shares: FloatArray, time: float
    ) -> dict[Lookup, FloatArray]:
        """The values (m * q,) of the fields at points of m simplices with corners (m, c, d).

        ``shares`` (q, c) are the barycentric coordinates of the points.
        """
        cell = _SIMPLICES[shares.shape[1]]
        places = lagrange(cell, self._degree).points
        at_nodes = np.column_stack([1.0 - places.sum(axis=1), places])
        nodes = np.einsum("nc,mcd->dmn", at_nodes, corners)
        basis = nodal_functions(cell, self._degree, shares[:, 1:])
        return {
            lookup: np.einsum("qn,mn->mq", basis, self._at(lookup, nodes, time)).reshape(-1)
            for lookup in self.fields
        }

    def _at(self, lookup: Lookup, x: FloatArray, time: float) -> FloatArray:
        places: dict[str, Any] = dict(zip(AXES, x, strict=False))
        return lookup.clamped(**places, **{TIME: time}) + 0.0 * x[0]
