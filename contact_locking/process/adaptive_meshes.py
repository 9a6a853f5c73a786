"""Solve, estimate, mark, refine, until the error is below the tolerance.

1. Solve on the mesh, the first time on the given mesh.
2. Estimate the relative error, and stop if it is small enough or if a limit is reached.
3. Mark the fewest cells that have a given share of the squared error, and those where a foundation
   enters between the nodes.
4. Refine the marked cells, and begin again.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np
from dolfinx import mesh as dmesh
from pydantic import ValidationError

from contact_locking.arrays import BoolArray
from contact_locking.certificate.laws import ENTRY
from contact_locking.errors import InputError, NotRefined
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.file import places
from contact_locking.mesh.file.data import MeshData
from contact_locking.mesh.file.topology import longest_edges
from contact_locking.mesh.given_mesh import NamedFacets
from contact_locking.mesh.whole_mesh import gather_cells
from contact_locking.meshes.curved import Curved
from contact_locking.monitor import Monitor
from contact_locking.process.refinement import (
    cells_at,
    entered_places,
    finer_mesh,
    marked_cells,
    squared_contributions,
)
from contact_locking.results.solution import Solution
from contact_locking.study_file.parameters.numerics import AdaptParameters
from contact_locking.values.concept import faults_of

S = TypeVar("S", bound=Solution)
# The error has to fall below this share of itself in so many meshes.
_LEAST_FALL, _MESHES = 0.95, 4


class MeshSequence:
    """The meshes of the loop with their errors, and the reason for its end.

    ``meshes`` has an entry for each mesh, as in summary.json.
    ``stopped`` is empty as long as the loop goes on.
    """

    def __init__(self, given: AdaptParameters) -> None:
        self.given = given
        self.meshes: list[dict[str, Any]] = []
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


def adapted(
    solve_on: Callable[[Domain], S],
    domain: Domain,
    given: AdaptParameters,
    monitor: Monitor,
    curved: tuple[Curved, ...] = (),
) -> Iterator[S]:
    """The solutions on adapted meshes, the first of them ``domain``; collective.

    ``curved`` are sides onto which new nodes move.  Raises InputError for cells that DOLFINx does
    not refine.
    """
    if not domain.kind.is_simplex:
        raise InputError(
            f"DOLFINx refines simplices only, and the mesh has {domain.kind.plural}; take "
            "triangles or tetrahedra (mesh.cells: simplex), or leave out adapt",
            "adapt",
        )
    sequence, began = MeshSequence(given), time.perf_counter()
    finer: Domain | None = domain
    while finer is not None:
        domain = finer
        solution = solve_on(domain)
        sequence.add(solution)
        finer = _refined(domain, solution, sequence, curved)
        monitor.mesh(len(sequence.meshes), sequence.in_words())
        if sequence.stopped and not sequence.is_reached:
            text = "the meshes were not refined until adapt.tolerance was reached: "
            told = [*solution.summary["warnings"], text + sequence.stopped]
            solution = solution.telling(warnings=told)
            monitor.message(f"warning: {text}{sequence.stopped}")
        seconds = time.perf_counter() - began
        yield solution.telling(adapt=sequence.summary(), wall_seconds=seconds)


def adapt(
    make_problem: Callable[..., Any],
    tolerance: float,
    mesh: dmesh.Mesh,
    tags: dmesh.MeshTags | None = None,
    **limits: float,
) -> Iterator[Solution]:
    """Solutions on finer meshes until ``|u - u_h|_a <= tolerance |u|_a`` by estimate; collective.

    The estimate is ``certificate.errors.mesh`` of the summary, which has the meshes so far and the
    reason for the end as ``adapt``.  Raises InputError for a mesh of other cells than simplices.

    Parameters
    ----------
    make_problem
        ``make_problem(mesh)``, with tags ``make_problem(mesh, tags)``, returns the ContactProblem
        on a mesh; R of friction needs a radius, as its default is that of the mesh
    tolerance
        the relative error at which the mesh is fine enough
    mesh, tags
        the first mesh, and tags of facets on its boundary, which pass to finer meshes
    limits
        ``share``, ``max_dofs`` and ``max_meshes``, as in the section ``adapt`` of a study file
    """
    values = set[int]() if tags is None else {int(value) for value in tags.values}
    names = {str(value): value for value in sorted(set().union(*mesh.comm.allgather(values)))}
    places = NamedFacets(mesh, tags, names)
    for name in names:
        places.add(name, "tags")

    def solve_on(domain: Domain) -> Solution:
        found = domain.facet_tags
        value = {mark: names[name] for name, marks in domain.facet_names.items() for mark in marks}
        marks = np.array([value[mark] for mark in found.values], dtype=np.int32)
        own = dmesh.meshtags(domain.mesh, domain.dim - 1, found.indices, marks)
        problem = make_problem(domain.mesh, *(() if tags is None else (own,)))
        if problem.domain.mesh is not domain.mesh:
            raise InputError("must return a problem on the mesh that it is given", "make_problem")
        with contextlib.closing(problem):
            return problem.solve()

    try:
        given = AdaptParameters.model_validate({"tolerance": tolerance, **limits})
    except ValidationError as error:
        fault = faults_of(error)[0]
        raise InputError(fault.message, str(fault.place[0])) from error
    return adapted(solve_on, places.domain(), given, Monitor())


def _refined(
    domain: Domain, solution: Solution, sequence: MeshSequence, curved: tuple[Curved, ...]
) -> Domain | None:
    """The next mesh; None, with the reason in ``sequence``, if there is none; collective."""
    given = sequence.given
    if sequence.stopped:
        return None
    found = gather_cells(domain, squared_contributions(solution))
    entered = entered_places(solution)

    def marks(data: MeshData) -> BoolArray:
        assert found is not None
        if sequence.stagnates and not entered:
            sizes = longest_edges(data.points, data.cells.nodes)
            least = int(np.argmin(sizes))
            centre = places.at(data.points[data.cells.nodes[least]].mean(axis=0))
            raise NotRefined(
                "the error has hardly fallen over the last meshes; the smallest cells, of size "
                f"{sizes[least]:.2g}, are at {centre}, where the solution may be singular"
            )
        return marked_cells(found, given.share) | cells_at(entered, data)

    try:
        return finer_mesh(domain, solution, marks, given.max_dofs, curved)
    except NotRefined as reason:
        sequence.stop(str(reason))
        return None
