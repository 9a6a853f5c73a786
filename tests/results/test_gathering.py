"""A run does without the whole body on one rank, and without the memory that its solve has freed.

What ranks send to each other beside DOLFINx and PETSc is as large as a surface at most.
Without a picture or adapted meshes nobody needs the body as a whole.  A body that is too
large for the memory of one rank can then be solved, certified, written and saved.
"""

from __future__ import annotations

import pickle
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI
from problems import block

import contact_locking
from contact_locking.mesh.sources import gather_mesh
from contact_locking.results.solution import StudySolution
from contact_locking.running import run as writing
from contact_locking.running import solving
from contact_locking.view.pictures.gather import gather

OUTPUT = {
    "output__picture": False,
    "output__probes": [{"line": {"from": [0.1, 0.5], "to": [0.9, 0.5], "count": 9}}],
}


@contextmanager
def messages() -> Iterator[list[int]]:
    """The sizes in bytes of all Python objects that this rank sends to other ranks or to itself."""
    sizes: list[int] = []

    def dumps(*arguments: Any, **named: Any) -> bytes:
        found = pickle.dumps(*arguments, **named)
        sizes.append(len(found))
        return found

    MPI.pickle.__init__(dumps, pickle.loads)  # type: ignore[misc]
    try:
        yield sizes
    finally:
        MPI.pickle.__init__()  # type: ignore[misc]


def field_of_body(solution: StudySolution, comm: MPI.Intracomm) -> int:
    """The least bytes of a rank's share of a field with one value for each node of the body."""
    owned = solution.displacement.function_space.dofmap.index_map.size_local
    least: int = comm.allreduce(8 * owned, op=MPI.MIN)
    return least


def test_a_run_without_picture_and_checkpoint_gathers_nothing_of_the_size_of_the_body(
    folder: Path, comm: MPI.Intracomm
) -> None:
    parameters = block(2, 1 / 48, **OUTPUT)
    with messages() as sizes:
        solution = solving.solve(parameters, comm)
        writing.write(solution, folder)
    assert solution.converged and len(sizes) > 100
    assert max(sizes) < 0.5 * field_of_body(solution, comm)
    # The same meters see what pictures and adapted meshes take.
    for whole in (lambda: gather(solution), lambda: gather_mesh(solution.domain)):
        with messages() as sizes:
            whole()
        assert max(sizes) > field_of_body(solution, comm)


@pytest.mark.serial
def test_only_sums_bypass_the_meters_as_buffers() -> None:
    buffers = re.compile(r"\b(?:comm|COMM_\w+)\.([A-Z][a-z]+)\(")
    package = Path(contact_locking.__file__).parent
    found = {
        name
        for path in package.rglob("*.py")
        for name in buffers.findall(path.read_text(encoding="utf-8"))
    }
    assert found <= {"Abort", "Allreduce", "Barrier", "Ibarrier"} and "Allreduce" in found
