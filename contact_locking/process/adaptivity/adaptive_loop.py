"""Solve, estimate, mark, refine, until the error is below the tolerance.

1. Solve on the mesh, the first time on the given mesh.
2. Estimate the relative error, and stop if it is small enough or if a limit is reached.
3. Mark the fewest cells that have a given share of the squared error, and those where a foundation
   enters between the nodes.
4. Refine the marked cells, and begin again.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

from contact_locking.arrays import BoolArray
from contact_locking.errors import InputError, NotRefined
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.file import places
from contact_locking.mesh.file.data import MeshData
from contact_locking.mesh.file.topology import longest_edges
from contact_locking.mesh.whole_mesh import gather_cells, gather_mesh
from contact_locking.meshes.curved import Curved
from contact_locking.monitor import Monitor
from contact_locking.process.adaptivity.marking import (
    cells_at,
    entered_places,
    marked_cells,
    squared_contributions,
)
from contact_locking.process.adaptivity.mesh_sequence import MeshSequence
from contact_locking.process.adaptivity.refinement import finer_mesh
from contact_locking.results.adapted_meshes import AdaptedMesh
from contact_locking.results.solution import Solution
from contact_locking.study_file.parameters.numerics import AdaptParameters

S = TypeVar("S", bound=Solution)


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
        solution = solution.telling(adapt=sequence.summary(), wall_seconds=seconds)
        yield dataclasses.replace(solution, meshes=tuple(sequence.pictures))


def _refined(
    domain: Domain, solution: Solution, sequence: MeshSequence, curved: tuple[Curved, ...]
) -> Domain | None:
    """The next mesh; None, with the reason in ``sequence``, if there is none; collective."""
    given, mesh = sequence.given, gather_mesh(domain)
    if mesh is not None:
        sequence.pictures.append(AdaptedMesh.of(mesh.data.points, mesh.data.cells.nodes))
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
        marked = marked_cells(found, given.share) | cells_at(entered, data)
        sequence.pictures[-1] = sequence.pictures[-1].with_marks(data.cells.nodes, marked)
        return marked

    try:
        return finer_mesh(domain, solution, marks, given.max_dofs, curved)
    except NotRefined as reason:
        sequence.stop(str(reason))
        return None
