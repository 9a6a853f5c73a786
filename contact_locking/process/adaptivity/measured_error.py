"""The error of a solution: one number that ends the loop, and its contributions by cell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.results.solution import StudySolution


@dataclass(frozen=True)
class ErrorMeasure:
    """A measure of the error in the energy norm.

    ``entry`` is the name of the measure below ``certificate.errors`` in the summary, whose value
    ``relative`` is the error over the energy norm of the solution.  ``squares`` gives the squared
    contributions (k,) of the owned cells, and None for a solution without them; only their ratios
    count.
    """

    entry: str
    squares: Callable[[StudySolution], FloatArray | None]

    def relative(self, solution: StudySolution) -> float | None:
        """The relative error; None if it is not known."""
        found = self._entry(solution).get("relative")
        return None if found is None else float(found)

    def reason(self, solution: StudySolution) -> str:
        """Why the error is not known."""
        return str(self._entry(solution).get("reason") or "the certificate has none")

    def _entry(self, solution: StudySolution) -> dict[str, Any]:
        found = solution.summary["certificate"]["errors"].get(self.entry)
        return found if isinstance(found, dict) else {}


def _estimated(solution: StudySolution) -> FloatArray | None:
    """``eta_K^2`` of the indicator by recovery, for the elastic stress, as in the estimate.

    With the locking stress the contributions would lead to locked zones, where this stress
    alternates between cells on every mesh.
    """
    return _squares(solution, solution.elastic_error_indicator)


def _bounded(solution: StudySolution) -> FloatArray | None:
    """The contributions of the cells to the guaranteed bound, with those of their contacts."""
    return _squares(solution, solution.error_bound)


def _squares(solution: StudySolution, field: fem.Function | None) -> FloatArray | None:
    """The squares (k,) of a function that is constant in each of the owned cells."""
    if field is None:
        return None
    mesh = solution.domain.mesh
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    return np.asarray(field.x.array[field.function_space.dofmap.list[:owned, 0]] ** 2)


#: The measures by the values of ``adapt.by``.
MEASURES = {
    "estimate": ErrorMeasure("mesh", _estimated),
    "bound": ErrorMeasure("guaranteed", _bounded),
}
