"""The meshes of the adaptive loop so far, and its end."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.process.adaptivity.marking import entered_places, only_misses
from contact_locking.results.adapted_meshes import AdaptedMesh
from contact_locking.results.solution import StudySolution
from contact_locking.study_file.parameters.numerics import AdaptParameters


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


# The error has to fall below this share of itself in so many meshes.
_LEAST_FALL, _MESHES = 0.95, 4


class MeshSequence:
    """The meshes of the loop with their errors, and the reason for its end.

    ``meshes`` has an entry for each mesh, as in summary.json, and ``pictures`` has the meshes
    themselves on rank 0.  ``stopped`` is empty as long as the loop goes on.
    """

    def __init__(self, given: AdaptParameters) -> None:
        self.given = given
        self.meshes: list[dict[str, Any]] = []
        self.pictures: list[AdaptedMesh] = []
        self.stopped = ""
        self.is_reached = False
        self._began = time.perf_counter()

    def add(self, solution: StudySolution, measure: ErrorMeasure) -> None:
        """Add the solution on a further mesh, and decide whether the loop goes on."""
        summary, errors = solution.summary, solution.summary["certificate"]["errors"]
        guaranteed = errors.get("guaranteed") or {}
        now = time.perf_counter()
        self.meshes.append(
            {
                "dofs": summary["dofs"],
                "cells": summary["cells"],
                "estimate": errors["mesh"]["relative"],
                "bound": guaranteed.get("relative"),
                "tangents": summary["iterations"]["tangents"],
                "seconds": now - self._began,
            }
        )
        self._began = now
        error = measure.relative(solution)
        is_entered = bool(entered_places(solution))
        if is_entered and (solution.converged or only_misses(solution)):
            # No error on this mesh tells of a foundation that enters between the nodes.
            if len(self.meshes) >= self.given.max_meshes:
                self.stop(f"adapt.max_meshes, {self.given.max_meshes}, is reached")
        elif not solution.converged:
            self.stop("the solve on this mesh did not converge")
        elif error is None:
            # A body at rest has no relative error.
            self.is_reached = _is_at_rest(solution)
            rests = "the body is at rest"
            self.stop(rests if self.is_reached else f"no error: {measure.reason(solution)}")
        elif error <= self.given.tolerance:
            self.is_reached = True
            self.stop(f"the {self.given.by} is below the tolerance")
        elif len(self.meshes) >= self.given.max_meshes:
            self.stop(f"adapt.max_meshes, {self.given.max_meshes}, is reached")

    def stop(self, reason: str) -> None:
        """End the loop."""
        self.stopped = self.stopped or reason

    def summary(self) -> dict[str, Any]:
        """The entry ``adapt`` of summary.json."""
        return {
            "tolerance": self.given.tolerance,
            "by": self.given.by,
            "reached": self.is_reached,
            "stopped": self.stopped or None,
            "meshes": [dict(entry) for entry in self.meshes],
        }

    def in_words(self) -> str:
        """The last mesh in words."""
        last = self.meshes[-1]
        error = last[self.given.by]
        shown = "no error" if error is None else f"{self.given.by} {100.0 * error:.3g} %"
        return (
            f"{last['dofs']} unknowns, {shown}, {last['tangents']} tangents, "
            f"{last['seconds']:.1f} s"
        )

    @property
    def stagnates(self) -> bool:
        """Whether the error has hardly fallen over the last meshes."""
        errors = [entry[self.given.by] for entry in self.meshes[-_MESHES:]]
        is_known = len(errors) == _MESHES and None not in errors
        return is_known and errors[-1] > _LEAST_FALL * errors[0]


def _is_at_rest(solution: StudySolution) -> bool:
    return bool(solution.summary["elastic_energy"] == 0.0)
