"""Solve, estimate, mark, refine, until the error is below the tolerance.

1. Solve on the mesh, the first time on the given mesh.
2. Estimate the relative error, and stop if it is small enough or if a limit is reached.
3. Mark the fewest cells that have a given share of the squared error, and those where a foundation
   enters between the nodes.
4. Refine the marked cells, and begin again.
"""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np
from dolfinx import mesh as dmesh

from contact_locking.arrays import BoolArray
from contact_locking.certificate.laws import ENTRY
from contact_locking.errors import InputError, NotRefined
from contact_locking.mesh.cell_kind import longest_edges
from contact_locking.mesh.data import MeshData, point_words
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.given_mesh import NamedFacets
from contact_locking.mesh.sources import gather_cells
from contact_locking.meshes.geometry import Curved
from contact_locking.monitor import Monitor
from contact_locking.process.refinement import (
    cells_at,
    entered_places,
    finer_mesh,
    marked_cells,
    squared_contributions,
)
from contact_locking.process.settings import Adaptation
from contact_locking.results.solution import Solution

S = TypeVar("S", bound=Solution)
# The error has to fall below this share of itself in so many meshes.
_LEAST_FALL, _MESHES = 0.95, 4


def adapted(
    solve_on: Callable[[Domain], S],
    domain: Domain,
    given: Adaptation,
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
    meshes: list[dict[str, Any]] = []
    began = since = time.perf_counter()
    finer: Domain | None = domain
    while finer is not None:
        domain = finer
        solution = solve_on(domain)
        summary, now = solution.summary, time.perf_counter()
        error = summary["certificate"]["errors"]["mesh"]["relative"]
        entry = {name: summary[name] for name in ("dofs", "cells")} | {"estimate": error}
        tangents = summary["iterations"]["tangents"]
        meshes.append(entry | {"tangents": tangents, "seconds": now - since})
        shown = "no error" if error is None else f"estimate {100.0 * error:.3g} %"
        words = f"{entry['dofs']} unknowns, {shown}, {tangents} tangents, {now - since:.1f} s"
        since = now
        is_reached, stopped = _end(solution, given)
        if len(meshes) >= given.max_meshes:
            stopped = stopped or f"adapt.max_meshes, {given.max_meshes}, is reached"
        errors = [entry["estimate"] for entry in meshes[-_MESHES:]]
        stagnates = len(errors) == _MESHES and None not in errors
        stagnates = stagnates and errors[-1] > _LEAST_FALL * errors[0]
        try:
            finer = None
            if not stopped:
                finer = _refined(domain, solution, given, stagnates, curved)
        except NotRefined as reason:
            stopped = str(reason)
        monitor.mesh(len(meshes), words)
        if stopped and not is_reached:
            text = f"the meshes were not refined until adapt.tolerance was reached: {stopped}"
            solution = solution.telling(warnings=[*summary["warnings"], text])
            monitor.message(f"warning: {text}")
        about = {"tolerance": given.tolerance, "reached": is_reached, "stopped": stopped or None}
        yield solution.telling(
            adapt={**about, "meshes": [dict(entry) for entry in meshes]},
            wall_seconds=time.perf_counter() - began,
        )


def _end(solution: Solution, given: Adaptation) -> tuple[bool, str]:
    """Whether the mesh is fine enough, and why the loop ends here, empty if it goes on."""
    certificate = solution.summary["certificate"]
    estimate, criteria = certificate["errors"]["mesh"], certificate["criteria"]
    broken = {name for name, item in criteria.items() if not item["holds"]}
    if entered_places(solution) and (solution.converged or broken == {ENTRY}):
        # No error on this mesh tells of a foundation that enters between the nodes.
        return False, ""
    if not solution.converged:
        return False, "the solve on this mesh did not converge"
    if estimate["relative"] is None:
        # A body at rest has no relative error.
        if solution.summary["elastic_energy"] == 0.0:
            return True, "the body is at rest"
        return False, f"no error: {estimate.get('reason')}"
    if estimate["relative"] <= given.tolerance:
        return True, "the estimate is below the tolerance"
    return False, ""


def _refined(
    domain: Domain,
    solution: Solution,
    given: Adaptation,
    stagnates: bool,
    curved: tuple[Curved, ...],
) -> Domain:
    """The next mesh; collective.  Raises NotRefined."""
    found = gather_cells(domain, squared_contributions(solution))
    entered = entered_places(solution)

    def marks(data: MeshData) -> BoolArray:
        assert found is not None
        if stagnates and not entered:
            sizes = longest_edges(data.points, data.cells.nodes)
            least = int(np.argmin(sizes))
            centre = point_words(data.points[data.cells.nodes[least]].mean(axis=0))
            raise NotRefined(
                "the error has hardly fallen over the last meshes; the smallest cells, of size "
                f"{sizes[least]:.2g}, are at {centre}, where the solution may be singular"
            )
        return marked_cells(found, given.share) | cells_at(entered, data)

    return finer_mesh(domain, solution, marks, given.max_dofs, curved)


def adapt(
    make_problem: Callable[..., Any],
    tolerance: float,
    mesh: dmesh.Mesh,
    tags: dmesh.MeshTags | None = None,
    cells: dmesh.MeshTags | None = None,
    **limits: float,
) -> Iterator[Solution]:
    """Solutions on finer meshes until ``|u - u_h|_a <= tolerance |u|_a`` by estimate; collective.

    The estimate is ``certificate.errors.mesh`` of the summary, which has the meshes so far and the
    reason for the end as ``adapt``.  Raises InputError for a mesh of other cells than simplices.

    Parameters
    ----------
    make_problem
        ``make_problem(mesh)`` returns the ContactProblem on a mesh; it gets ``tags`` and ``cells``
        of this mesh as further arguments, where the first mesh has them; R of friction needs a
        radius, as its default is that of the mesh
    tolerance
        the relative error at which the mesh is fine enough
    mesh, tags, cells
        the first mesh, tags of facets on its boundary and tags of its cells, which pass to finer
        meshes
    limits
        ``share``, ``max_dofs`` and ``max_meshes`` of :class:`Adaptation`
    """
    given = Adaptation(tolerance=tolerance, **limits)
    names, regions = (
        {str(value): value for value in _values(found, mesh)} for found in (tags, cells)
    )
    places = NamedFacets(mesh, tags, names)
    for name in names:
        places.add(name, "tags")
    domain = places.domain()
    if cells is not None:
        numbers = domain.cell_tags.values.copy()
        # A cell without a tag has the number 0, which may be a tag of others.
        numbers[cells.indices] = 1 + np.searchsorted([*regions.values()], cells.values)
        found = dmesh.meshtags(mesh, domain.dim, domain.cell_tags.indices, numbers)
        named = {name: number for number, name in enumerate(regions, start=1)}
        domain = dataclasses.replace(domain, cell_tags=found, cell_names=named)

    def solve_on(domain: Domain) -> Solution:
        made, known = [], domain.facet_names
        facets = {mark: names[name] for name, marks in known.items() for mark in marks}
        in_cells = {number: regions[name] for name, number in domain.cell_names.items()}
        for given, dim, found, values in (
            (tags, domain.dim - 1, domain.facet_tags, facets),
            (cells, domain.dim, domain.cell_tags, in_cells),
        ):
            if given is not None:
                tagged = np.isin(found.values, [*values])
                marks = np.array([values[mark] for mark in found.values[tagged]], dtype=np.int32)
                made.append(dmesh.meshtags(domain.mesh, dim, found.indices[tagged], marks))
        problem = make_problem(domain.mesh, *made)
        if problem.domain.mesh is not domain.mesh:
            raise InputError("must return a problem on the mesh that it is given", "make_problem")
        with contextlib.closing(problem):
            return problem.solve()

    return adapted(solve_on, domain, given, Monitor())


def _values(tags: dmesh.MeshTags | None, mesh: dmesh.Mesh) -> list[int]:
    """The values of tags, the same on all ranks; collective."""
    values = set[int]() if tags is None else {int(value) for value in tags.values}
    return sorted(set().union(*mesh.comm.allgather(values)))
