"""Solve, estimate, mark, refine, until the error is below the tolerance.

1. Solve on the mesh, the first time on the mesh of the study.
2. Estimate the relative error, and stop if it is small enough or if a limit is reached.
3. Mark the fewest cells that have a given share of the squared error, and those where a foundation
   enters between the nodes.
4. Refine the marked cells, and begin again.
"""

from __future__ import annotations

import dataclasses
import time
from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import BoolArray
from contact_locking.errors import InputError, NotRefined
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.file import places
from contact_locking.mesh.file.data import MeshData
from contact_locking.mesh.file.topology import longest_edges
from contact_locking.mesh.whole_mesh import gather_cells, gather_mesh
from contact_locking.monitor import Attentive, Monitor
from contact_locking.process import solving
from contact_locking.process.adaptivity.marking import (
    cells_at,
    entered_places,
    marked_cells,
    squared_contributions,
)
from contact_locking.process.adaptivity.mesh_sequence import MeshSequence
from contact_locking.process.adaptivity.refinement import finer_mesh
from contact_locking.process.checkpoint import stored as checkpoint
from contact_locking.results.adapted_meshes import AdaptedMesh
from contact_locking.results.solution import StudySolution
from contact_locking.study.assembly import mesh_of
from contact_locking.study_file import require_parameters
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.numerics import AdaptParameters


def solve(
    parameters: Parameters,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
) -> StudySolution:
    """Solve (25)/(26) for the given parameters; collective.

    With a section ``adapt`` this is the last solution of `solve_adaptively`.  For the arguments and
    the errors see `contact_locking.process.solving.solve`.
    """
    require_parameters(parameters)
    if parameters.adapt is None:
        domain = checkpoint.refined_mesh(restart, comm)
        return solving.solve(parameters, comm, monitor, petsc_options, restart, domain)
    # Only the last solution is kept in memory.
    solutions = solve_adaptively(parameters, comm, monitor, petsc_options, restart)
    return deque(solutions, maxlen=1)[0]


def solve_adaptively(
    parameters: Parameters,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
) -> Iterator[StudySolution]:
    """The solutions on the adapted meshes, one after the other; collective.

    The section ``adapt`` sets the tolerance and the limits; without it the defaults hold.  The
    summary of each solution has the entry ``adapt`` with all meshes so far.  In the last summary
    ``adapt.stopped`` is the reason why there is no further mesh.  ``restart`` is the folder of a
    run with a checkpoint, on the first mesh or on a refined mesh, from which the loop goes on.

    The loop ends where the estimate of the error is not known.  Raises InputError for data that
    cannot be used.
    """
    monitor = Attentive(monitor or Monitor())
    require_parameters(parameters)
    given = parameters.adapt or AdaptParameters()
    sequence = MeshSequence(given)
    began = time.perf_counter()
    domain = checkpoint.refined_mesh(restart, comm)
    domain = domain or mesh_of(parameters, comm)
    if not domain.kind.is_simplex:
        raise InputError(
            f"DOLFINx refines simplices only, and the mesh has {domain.kind.plural}; take "
            "triangles or tetrahedra (mesh.cells: simplex), or leave out adapt",
            "adapt",
        )
    while True:
        solution = solving.solve(parameters, comm, monitor, petsc_options, restart, domain)
        restart = None
        sequence.add(solution)
        finer = _refined(solution, sequence)
        monitor.mesh(len(sequence.meshes), sequence.in_words())
        if sequence.stopped and not sequence.is_reached:
            text = "the meshes were not refined until adapt.tolerance was reached: "
            told = [*solution.summary["warnings"], text + sequence.stopped]
            solution = solution.telling(warnings=told)
            monitor.message(f"warning: {text}{sequence.stopped}")
        seconds = time.perf_counter() - began
        solution = solution.telling(adapt=sequence.summary(), wall_seconds=seconds)
        yield dataclasses.replace(solution, meshes=tuple(sequence.pictures))
        if finer is None:
            return
        domain = finer


def _refined(solution: StudySolution, sequence: MeshSequence) -> Domain | None:
    """The next mesh; None, with the reason in ``sequence``, if there is none; collective."""
    domain, given = solution.domain, sequence.given
    mesh = gather_mesh(domain)
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
        return finer_mesh(solution, marks, given.max_dofs)
    except NotRefined as reason:
        sequence.stop(str(reason))
        return None
