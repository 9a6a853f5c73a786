"""The values of tables in the forms of loads."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any

import dolfinx
from dolfinx import fem

from contact_locking.arrays import AXES, FloatArray
from contact_locking.expressions import TIME, Expression, Lookup
from contact_locking.fields.clock import Clock


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
        self._clock = clock
        #: The coefficients in UFL.
        self.coefficients: dict[Lookup, Any] = {}
        space: fem.FunctionSpace | None = None
        for lookup in (item for expression in expressions for item in expression.lookups):
            if lookup.names <= {TIME}:
                self.coefficients[lookup] = fem.Constant(mesh, 0.0)
            else:
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
                coefficient.interpolate(partial(self._at, lookup))

    def _at(self, lookup: Lookup, x: FloatArray) -> FloatArray:
        places: dict[str, Any] = dict(zip(AXES, x, strict=True))
        return lookup.clamped(**places, **{TIME: self._clock.now}) + 0.0 * x[0]
