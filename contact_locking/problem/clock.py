"""The present time of a problem whose loads and gaps depend on the time t, and its tables."""

from __future__ import annotations

from collections.abc import Mapping

import dolfinx
from dolfinx import fem

from contact_locking.expressions import NO_TABLES, TIME, Expression, Table


class Clock:
    """The time t: ``now`` for values at points, ``constant`` for the forms.

    ``tables`` are the tables that expressions of loads, gaps and friction may use.
    """

    def __init__(
        self,
        mesh: dolfinx.mesh.Mesh,
        start: float = 0.0,
        tables: Mapping[str, Table] = NO_TABLES,
    ) -> None:
        self.tables = tables
        self.constant = fem.Constant(mesh, float(start))

    @property
    def now(self) -> float:
        """The present time."""
        return float(self.constant.value)

    def set(self, time: float) -> None:
        """Put the clock to a time."""
        self.constant.value = time


def is_timed(expression: Expression) -> bool:
    """Whether the value of an expression depends on the time."""
    return TIME in expression.names
