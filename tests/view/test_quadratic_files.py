"""Checkpoints, files and pictures of quadratic displacements, and a mesh file of second order."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest
import ufl
from mpi4py import MPI
from quadratic_bodies import solved, solved_cube, square
from test_elements import LIMIT, benchmark

from contact_locking import study_file
from contact_locking.errors import InputError
from contact_locking.fem.compiled import integral
from contact_locking.process import solving
from contact_locking.process.checkpoint import stored as checkpoint
from contact_locking.results import fields
from contact_locking.results.solution import StudySolution
from contact_locking.running import writing
from contact_locking.study_file import from_mapping
from contact_locking.view.pictures.gather import gather
from contact_locking.view.pictures.snapshot import Snapshot


@pytest.mark.skipif(checkpoint.unavailable() is not None, reason=str(checkpoint.unavailable()))
@pytest.mark.parametrize("dim", [2, 3])
def test_a_checkpoint_restarts_what_it_was_saved_from(
    dim: int, comm: MPI.Intracomm, tmp_path: Path
) -> None:
    folder = comm.bcast(tmp_path)
    saved = square() if dim == 2 else solved_cube()
    writing.save(saved, folder)
    # Any number of ranks can read it.
    again = solving.solve(saved.parameters, MPI.COMM_SELF, restart=folder)
    assert again.converged and again.summary["iterations"]["tangents"] == 0
    assert again.summary["compliance"] == pytest.approx(saved.summary["compliance"], rel=1e-12)


@pytest.mark.skipif(checkpoint.unavailable() is not None, reason=str(checkpoint.unavailable()))
def test_a_checkpoint_of_another_element_is_refused(comm: MPI.Intracomm, tmp_path: Path) -> None:
    folder = comm.bcast(tmp_path)
    writing.save(square(), folder)
    with pytest.raises(InputError, match=r"restart with discretisation\.degree: ") as raised:
        solving.solve(benchmark(4), comm, restart=folder)
    assert raised.value.key == "discretisation.degree"


def test_fields_for_paraview_are_quadratic_in_each_cell() -> None:
    solution = square()
    found = {f.name: f for f in fields.discontinuous(solution)}
    assert set(found) == set(fields.FIELD_NAMES)
    assert all(f.function_space.ufl_element().degree == 2 for f in found.values())
    dx = ufl.Measure("dx", domain=solution.domain.mesh)
    for name in ("displacement", "elastic_stress", "locking_stress", "contact_pressure"):
        apart = found[name] - getattr(solution, name)
        assert integral(solution.domain, ufl.inner(apart, apart) * dx) <= 1e-20
    largest = solution.domain.comm.allreduce(found["strain_norm"].x.array.max(), op=MPI.MAX)
    assert largest == pytest.approx(solution.summary["strain_norm_max_in_cells"])
    assert set(np.unique(found["locked"].x.array)) == {0.0, 0.5, 1.0}
    assert set(np.unique(found["contact_state"].x.array)) <= {0.0, 1.0, 2.0}


def test_the_file_for_paraview_has_cells_of_higher_order(
    comm: MPI.Intracomm, tmp_path: Path
) -> None:
    adios2 = pytest.importorskip("adios2")
    path = comm.bcast(tmp_path) / "fields.bp"
    functions = fields.discontinuous(square())
    written = fields.Series(functions, path, comm)
    written.add(0.0)
    written.close()
    if comm.rank == 0:
        with adios2.FileReader(str(path)) as file:
            # VTK's Lagrange triangle.
            assert int(file.read("types")) == 69
        size = sum(entry.stat().st_size for entry in path.rglob("*") if entry.is_file())
        assert size <= fields.size(functions, comm)
    else:
        fields.size(functions, comm)


def volume(x: Any, simplices: Any) -> float:
    edges = x[simplices[:, 1:]] - x[simplices[:, :1]]
    return float(np.abs(np.linalg.det(edges)).sum()) / (2.0 if x.shape[1] == 2 else 6.0)


def test_a_picture_shows_cells_of_degree_two_in_pieces(comm: MPI.Intracomm) -> None:
    cases = [(square(), 4 * 8), (solved_cube(), 6 * 2 * 4 * 4)]
    for solution, sides in cases:
        body = gather(solution)
        assert (body is None) == (comm.rank > 0)
        if body is None:
            continue
        assert len(body.cells) == solution.domain.num_cells * 2**body.dim
        assert volume(body.x, body.cells) == pytest.approx(1.0)
        assert len(body.boundary) == sides
        # Each face of the boundary is a face of its piece.
        pieces = body.cells[body.boundary_cell]
        assert all(
            np.isin(face, piece).all() for face, piece in zip(body.boundary, pieces, strict=True)
        )
        assert_values(body, solution)


def assert_values(body: Snapshot, solution: StudySolution) -> None:
    assert body.strain_norm.max() <= solution.summary["strain_norm_max_in_cells"]
    assert body.strain_norm.max() >= 0.95 * LIMIT
    share = body.locked.mean()
    assert share == pytest.approx(solution.summary["locked_fraction"], abs=0.1)
    points = body.contact.points
    assert body.x[body.contact.vertices] == pytest.approx(points.x)


@pytest.mark.serial
def test_a_run_writes_everything(tmp_path: Path) -> None:
    solution = square()
    assert writing.write(solution, tmp_path) == []
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["discretisation"] == {"degree": 2}
    assert (tmp_path / "picture.png").stat().st_size > 20_000
    # The corners and the middles of the edges, and a line of names.
    assert len((tmp_path / "contact.csv").read_text().splitlines()) == 9 + 1
    assert study_file.load(tmp_path / "parameters.yaml").parameters == solution.parameters


@pytest.mark.serial
def test_a_mesh_file_of_second_order_is_read_by_its_corners(tmp_path: Path) -> None:
    path = tmp_path / "disk.msh"
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        disk = gmsh.model.occ.addDisk(0, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        rim = [abs(tag) for _, tag in gmsh.model.getBoundary([(2, disk)])]
        gmsh.model.addPhysicalGroup(2, [disk], name="body")
        gmsh.model.addPhysicalGroup(1, rim, name="rim")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(path))
        gmsh.model.mesh.setOrder(1)
        gmsh.write(str(tmp_path / "straight.msh"))
    finally:
        gmsh.finalize()
    loads = {"displacements": [{"on": "rim", "value": [0, 0]}], "body_force": [0, -0.01]}
    data = {"discretisation": {"degree": 2}, "contact": {"on": []}, "loads": loads}
    energies = []
    for name in ("disk.msh", "straight.msh"):
        study = from_mapping(data | {"mesh": {"file": str(tmp_path / name)}})
        summary = solved(study, MPI.COMM_SELF).summary
        assert summary["discretisation"]["degree"] == 2
        energies.append(summary["elastic_energy"])
    assert energies[0] == pytest.approx(energies[1], rel=1e-9)
