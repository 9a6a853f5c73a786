"""Checkpoints, files and pictures of quadratic displacements, and a mesh file of second order."""

from __future__ import annotations

from pathlib import Path

import gmsh
import numpy as np
import pytest
import ufl
from mpi4py import MPI
from problems import solved
from quadratic_bodies import square
from test_elements import benchmark

from contact_locking.errors import InputError
from contact_locking.fem.compiled import integral
from contact_locking.results import fields
from contact_locking.running import run as writing
from contact_locking.running import solving
from contact_locking.study_file import from_mapping


def test_a_checkpoint_of_another_element_is_refused(comm: MPI.Intracomm, tmp_path: Path) -> None:
    folder = comm.bcast(tmp_path)
    writing.save(square(), folder)
    with pytest.raises(InputError, match=r"is of another mesh or element"):
        solving.solve(benchmark(4), comm, restart=folder)


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
