"""The meshes of builders and of files: made or read on one rank, and distributed."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from mpi4py import MPI

from contact_locking.errors import with_key
from contact_locking.mesh.diagnosis import DistributedCells, Touching, check_cells
from contact_locking.mesh.distribution import distribute, on_first_rank
from contact_locking.mesh.domain import Domain, about, diagnosed, sound
from contact_locking.mesh.file.data import MeshData
from contact_locking.mesh.file.diagnosis import check_arrays
from contact_locking.mesh.file.gmsh_model import extract
from contact_locking.mesh.file.reader import read
from contact_locking.meshes import build


def from_geometry(geometry: Any, comm: MPI.Intracomm, contact: Collection[str] = ()) -> Domain:
    """Generate a geometry of ``meshes`` with Gmsh on rank 0 and distribute it; collective.

    ``contact`` names the boundary parts that ``h_contact`` refines.
    """
    origin = type(geometry).__name__.lower()

    def make() -> MeshData:
        with build(geometry, contact=contact) as model:
            mesh = extract(model, origin)
        if not mesh.kind.is_simplex:
            check_cells(mesh)
        return mesh

    first = with_key("mesh.builder", lambda: on_first_rank(comm, make))
    return sound(first, comm, origin, geometry.bodies)


def from_file(path: Path, comm: MPI.Intracomm, touching: Touching = ()) -> Domain:
    """Read a Gmsh file with named physical groups on rank 0 and distribute it; collective.

    ``touching`` are pairs of boundary parts that may touch each other without shared nodes.  Cells
    of second order are read by their corners, with a warning.
    Raises InputError if the file cannot be read, if the cells are not of one kind and of first or
    second order, and if the mesh is not a body.
    """
    data = with_key("mesh.file", lambda: on_first_rank(comm, lambda: read(path)))
    return with_key("mesh.file", lambda: from_arrays(data, comm, str(path), touching))


def from_arrays(
    data: MeshData, comm: MPI.Intracomm, origin: str, touching: Touching = ()
) -> Domain:
    """Check and distribute a mesh, which rank 0 has and messages call ``origin``; collective."""
    with about(origin):
        check_arrays(comm, data)
        made = distribute(comm, data)
        cells = DistributedCells(made.mesh, made.numbers)
        groups, warnings = made.groups, data.warnings
        return diagnosed(made.mesh, cells, made.regions, groups, origin, touching, warnings)
