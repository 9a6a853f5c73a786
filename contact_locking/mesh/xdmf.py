"""The mesh of the body in an XDMF file, read and checked by all ranks together.

Every rank reads a share of the file, and no rank ever has the whole mesh.  DOLFINx reads grids by
their names, and does not list the names.  The numbers are in an HDF5 file beside the file, which
has the same name with the ending .h5; DOLFINx reads no other file.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from dolfinx import io
from dolfinx import mesh as dmesh
from mpi4py import MPI

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import InputError, with_key
from contact_locking.files.readable import require_file
from contact_locking.mesh.array_checks import check_arrays
from contact_locking.mesh.cell_kind import INTERVAL, NAMED, CellKind
from contact_locking.mesh.data import MeshData, MeshElements, and_more, data_file
from contact_locking.mesh.diagnosis import DistributedCells, require_different
from contact_locking.mesh.distribution import EntityGroup, Regions, mesh_of
from contact_locking.mesh.domain import Domain, about, diagnosed
from contact_locking.parallel import agree, on_root

_KINDS = {"polyline": INTERVAL, **NAMED}


@dataclass(frozen=True)
class Grid:
    """The elements of one kind under one name."""

    name: str
    kind: CellKind

    @property
    def dim(self) -> int:
        return self.kind.dim


def read_grids(path: Path) -> tuple[Grid, list[Grid]]:
    """The grid of the cells of the body, and those of groups of cells and facets; for one process.

    The first grid is the mesh.  Every other grid has tags of cells or facets, and is a group.
    Raises InputError for a file that is no mesh of cells of one kind.
    """
    require_file(path)
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise InputError(f"{path} is not an XML file: {error}") from None
    data = data_file(path)
    sources = [(element.text or "").strip().partition(":")[0] for element in root.iter("DataItem")]
    if not data.exists() or any(source != data.name for source in sources):
        raise InputError(
            f"{path} does not have its numbers in {data.name} beside it: write it with "
            "dolfinx.io.XDMFFile, or with meshio and data_format='HDF'"
        )
    grids = [_grid(grid, path) for grid in root.iterfind("Domain/Grid")]
    if not grids:
        raise InputError(f"{path} holds no grid; write the mesh first")
    if len({grid.name for grid in grids}) < len(grids):
        raise InputError(f"{path} has two grids with one name")
    cells, *groups = grids
    if cells.dim < 2:
        raise InputError(f"{path} is a 1D mesh; a body in 2D or 3D is needed")
    for grid in groups:
        if grid.kind not in (cells.kind, cells.kind.facet):
            raise InputError(
                f"{path}: grid {grid.name!r} has neither {cells.kind.plural} nor "
                f"{cells.kind.facet_word}s of the body"
            )
    return cells, groups


def _grid(grid: ElementTree.Element, path: Path) -> Grid:
    name, topology = grid.get("Name", ""), grid.find("Topology")
    kind = "" if topology is None else topology.get("TopologyType", "")
    # Names are printed, and terminals read some characters as commands; quotes end an XPath.
    if not name or not name.isprintable() or "'" in name:
        raise InputError(f"{path}: the name of a grid is {name!a}, which is no name")
    if kind.lower() not in _KINDS:
        known = ", ".join(kind.plural for kind in NAMED.values())
        raise InputError(
            f"{path}: grid {name!r} has the topology {kind!a}; write cells of one kind and of "
            f"first order ({known}), and tags of them and of their facets"
        )
    return Grid(name, _KINDS[kind.lower()])


def from_xdmf(path: Path, comm: MPI.Intracomm) -> Domain:
    """The mesh of a file that `dolfinx.io.XDMFFile` has written; collective.

    The first grid of the file is the mesh.  Every other grid has tags of cells or facets.  Tags
    with one value are a group with the name of the grid.  Of tags with several values each value
    is a group, whose name is the number.  Cells without any tags are one region with the name of
    the mesh.

    Raises InputError if the file cannot be read, if the cells are not of one kind and first order,
    and if the mesh is not a body.
    """
    return with_key("mesh.file", lambda: _read(path, comm))


def _read(path: Path, comm: MPI.Intracomm) -> Domain:
    of_cells, grids = on_root(comm, lambda: read_grids(path))
    with _explained(path), io.XDMFFile(comm, path, "r") as file:
        mesh = _mesh(file, of_cells)
        cells = DistributedCells(mesh)
        inside, on_facets = (
            [group for grid in grids if grid.dim == dim for group in _groups(file, grid, mesh)]
            for dim in (of_cells.dim, of_cells.dim - 1)
        )
        regions = _regions(inside, of_cells, mesh)
    with about(str(path)):
        return diagnosed(mesh, cells, regions, on_facets, str(path))


def _mesh(file: io.XDMFFile, grid: Grid) -> dmesh.Mesh:
    """The mesh, distributed; collective."""
    comm, kind, name = file.comm, grid.kind, grid.name
    cells = np.asarray(file.read_topology_data(name), dtype=np.int64)
    points = np.asarray(file.read_geometry_data(name), dtype=float)
    if not comm.allreduce(len(cells)):
        raise InputError("the mesh has no cells")
    first, first_cell = (comm.exscan(len(rows)) or 0 for rows in (points, cells))
    total = comm.allreduce(len(points))
    agree(comm, lambda: _check_sizes(kind, points, cells, first_cell, total))
    numbers, cell_numbers = first + np.arange(len(points)), first_cell + np.arange(len(cells))
    elements = MeshElements.unnamed(cells, cell_numbers)
    check_arrays(comm, MeshData(kind.dim, points, numbers, elements))
    mesh = mesh_of(comm, points, cells, kind)
    used = mesh.geometry.index_map().size_global
    if used != total:
        raise InputError(
            f"{total - used} of its {total} nodes belong to no cell; write the nodes of cells alone"
        )
    return mesh


def _check_sizes(
    kind: CellKind, points: FloatArray, cells: IntArray, first: int, total: int
) -> None:
    """Raise InputError for arrays of other sizes, and for nodes that are not there."""
    if points.shape[1:] != (kind.dim,):
        raise InputError(
            f"the points of a mesh of {kind.plural} have {kind.dim} coordinates, and those of the "
            "file have others; write a body in the plane without z (meshio: prune_z_0)"
        )
    if cells.shape[1:] != (kind.corners,):
        raise InputError(f"the sizes of its arrays are not those of a mesh of {kind.plural}")
    outside = ((cells < 0) | (cells >= total)).any(axis=1)
    if outside.any():
        raise InputError(
            f"{kind.name} {first + int(np.argmax(outside))} names nodes that are none of its "
            f"{total}{and_more(int(outside.sum()))}"
        )


def _groups(file: io.XDMFFile, grid: Grid, mesh: dmesh.Mesh) -> list[EntityGroup]:
    """Name and local entities of each group in a grid, and how many are missing; collective."""
    tags = file.read_meshtags(mesh, grid.name)
    comm, owned = mesh.comm, mesh.topology.index_map(grid.dim).size_local
    total = comm.allreduce(len(file.read_topology_data(grid.name)))
    missing = total - comm.allreduce(int(np.count_nonzero(tags.indices < owned)))
    values = np.unique(np.concatenate(comm.allgather(np.unique(tags.values))))
    if len(values) < 2:
        return [EntityGroup(grid.name, tags.indices, missing)]
    return [EntityGroup(str(value), tags.find(value), missing) for value in values]


def _regions(groups: list[EntityGroup], body: Grid, mesh: dmesh.Mesh) -> Regions:
    """The regions, one for each cell; collective."""
    index_map = mesh.topology.index_map(body.dim)
    count = index_map.size_local + index_map.num_ghosts
    if not groups:
        return Regions(np.ones(count, dtype=np.int32), {body.name: 1})
    require_different([group.name for group in groups], "cells")
    names = {group.name: number for number, group in enumerate(groups, start=1)}
    numbers = np.zeros(count, dtype=np.int32)

    def fill() -> None:
        for name, entities in ((group.name, group.entities) for group in groups):
            if len(both := numbers[entities][numbers[entities] > 0]):
                first, other = sorted((name, list(names)[both[0] - 1]))
                raise InputError(
                    f"groups {first!r} and {other!r} share cells; let each region have one name"
                )
            numbers[entities] = names[name]

    agree(mesh.comm, fill)
    return Regions(numbers, names)


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Put the name of the file before a message, and raise an InputError for an error of HDF5."""
    try:
        with about(str(path)):
            yield
    except RuntimeError as error:
        raise InputError(f"{path} cannot be read with {data_file(path).name}: {error}") from error


_MESH = "mesh"
# These characters end names in XML, in XPath or in HDF5.
_FORBIDDEN = frozenset("/'\"<>&")


def export(domain: Domain, path: Path) -> None:
    """Write a mesh and its groups as a file that `from_xdmf` reads, with its data; collective.

    The files are ``path`` and the file beside it with the ending .h5.  Raises InputError for the
    name of a group that XDMF files cannot have, and for files that cannot be written.
    """
    names = [_MESH, *domain.cell_names, *domain.facet_names]
    for name in names:
        if names.count(name) > 1 or _FORBIDDEN & set(name) or name in (".", ".."):
            raise InputError(f"a group named {name!r} cannot be written to an XDMF file")
    mesh = domain.mesh
    mesh.name = _MESH
    groups = [
        *((domain.dim, name, domain.cells(name)) for name in domain.cell_names),
        *((domain.dim - 1, name, domain.facets((name,))) for name in domain.facet_names),
    ]
    try:
        with io.XDMFFile(domain.comm, path, "w") as file:
            file.write_mesh(mesh)
            for number, (dim, name, entities) in enumerate(groups, start=1):
                group = dmesh.meshtags(
                    mesh, dim, entities, np.full(len(entities), number, dtype=np.int32)
                )
                group.name = name
                file.write_meshtags(group, mesh.geometry)
    except RuntimeError as error:
        raise InputError(f"cannot write {path}: {error}") from error
