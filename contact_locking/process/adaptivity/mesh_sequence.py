"""The meshes of the adaptive loop so far, and its end."""

from __future__ import annotations

import time
from typing import Any

from contact_locking.certificate.laws import ENTRY
from contact_locking.process.adaptivity.marking import entered_places
from contact_locking.results.adapted_meshes import AdaptedMesh
from contact_locking.results.solution import Solution
from contact_locking.study_file.parameters.numerics import AdaptParameters

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

    def add(self, solution: Solution) -> None:
        """Add the solution on a further mesh, and decide whether the loop goes on."""
        summary, now = solution.summary, time.perf_counter()
        entry = summary["certificate"]["errors"]["mesh"]
        error = entry["relative"]
        self.meshes.append(
            {
                "dofs": summary["dofs"],
                "cells": summary["cells"],
                "estimate": error,
                "tangents": summary["iterations"]["tangents"],
                "seconds": now - self._began,
            }
        )
        self._began = now
        criteria = summary["certificate"]["criteria"]
        broken = {name for name, item in criteria.items() if not item["holds"]}
        if entered_places(solution) and (solution.converged or broken == {ENTRY}):
            pass  # No error on this mesh tells of a foundation that enters between the nodes.
        elif not solution.converged:
            self.stop("the solve on this mesh did not converge")
        elif error is None:
            # A body at rest has no relative error.
            self.is_reached = bool(summary["elastic_energy"] == 0.0)
            reason = f"no error: {entry.get('reason')}"
            self.stop("the body is at rest" if self.is_reached else reason)
        elif error <= self.given.tolerance:
            self.is_reached = True
            self.stop("the estimate is below the tolerance")
        if len(self.meshes) >= self.given.max_meshes:
            self.stop(f"adapt.max_meshes, {self.given.max_meshes}, is reached")

    def stop(self, reason: str) -> None:
        """End the loop, for the first of several reasons."""
        self.stopped = self.stopped or reason

    def summary(self) -> dict[str, Any]:
        """The entry ``adapt`` of summary.json."""
        return {
            "tolerance": self.given.tolerance,
            "reached": self.is_reached,
            "stopped": self.stopped or None,
            "meshes": [dict(entry) for entry in self.meshes],
        }

    def in_words(self) -> str:
        """The last mesh in words."""
        last = self.meshes[-1]
        error = last["estimate"]
        shown = "no error" if error is None else f"estimate {100.0 * error:.3g} %"
        return (
            f"{last['dofs']} unknowns, {shown}, {last['tangents']} tangents, "
            f"{last['seconds']:.1f} s"
        )

    @property
    def stagnates(self) -> bool:
        """Whether the error has hardly fallen over the last meshes."""
        errors = [entry["estimate"] for entry in self.meshes[-_MESHES:]]
        is_known = len(errors) == _MESHES and None not in errors
        return is_known and errors[-1] > _LEAST_FALL * errors[0]
