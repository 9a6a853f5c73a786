"""From a mesh as arrays on rank 0 to a DOLFINx mesh on all ranks, and sums over the ranks."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import basix.ufl
import numpy as np
import ufl
from dolfinx import common, default_real_type, graph, la
from dolfinx import mesh as dmesh
from dolfinx.io.utils import distribute_entity_data
from mpi4py import MPI

from contact_locking.arrays import BoolArray, FloatArray, IndexArray, IntArray
from contact_locking.mesh.data import CellKind, MeshData, components
from contact_locking.parallel import on_root


def summed(index_map: common.IndexMap, places: IndexArray, values: FloatArray) -> FloatArray:
    """(n, m) the sums over all ranks of values (..., m) at local places (...); collective."""
    size, rows = values.shape[-1], places.reshape(-1)
    total = la.vector(index_map, size)
    at = total.array.reshape(-1, size)
    for column, summands in enumerate(values.reshape(-1, size).T):
        at[:, column] = np.bincount(rows, summands, len(at))
    total.scatter_reverse(la.InsertMode.add)
    total.scatter_forward()
    return np.array(at)


def marked(index_map: common.IndexMap, places: IndexArray) -> BoolArray:
    """(n,) which local places, ghosts included, any rank has among ``places``; collective."""
    return summed(index_map, places, np.ones((*places.shape, 1)))[:, 0] > 0.0


def marked_facets(mesh: dmesh.Mesh, facets: IndexArray) -> BoolArray:
    """Which local facets, ghosts included, any rank has in ``facets``; collective."""
    return marked(mesh.topology.index_map(mesh.topology.dim - 1), facets)


_SCOTCH_THREADS = "SCOTCH_PTHREAD_NUMBER"


class Regions(NamedTuple):
    """The number (k,) of the region of each local cell, 0 for none, and the numbers by name."""

    numbers: IndexArray
    names: dict[str, int]


class Distributed(NamedTuple):
    """A mesh with its regions, and marks of local facets by the names of its groups."""

    mesh: dmesh.Mesh
    regions: Regions
    facets: dict[str, BoolArray]


def on_first_rank(comm: MPI.Intracomm, make: Callable[[], MeshData]) -> MeshData:
    """The mesh that ``make`` returns on rank 0, and none of its points elsewhere; collective."""
    held: list[MeshData] = []

    def prepare() -> MeshData:
        held.append(make())
        return held[0].empty

    nothing = on_root(comm, prepare)
    return held[0] if held else nothing


def distribute(comm: MPI.Intracomm, data: MeshData) -> Distributed:
    """Distribute cells of a kind and named facets; collective.

    All points, cells and facets are on rank 0.  Nodes without a cell are left out.  The same mesh
    is distributed in the same way each time, so that solutions can be compared node by node.
    """
    kind, dim = data.kind, data.dim
    cells = data.cells.nodes
    used = np.zeros(len(data.points), dtype=bool)
    used[cells] = True
    row = np.where(used, np.cumsum(used) - 1, -1)
    corners = row[cells]
    mesh = mesh_of(comm, data.points[used], corners, kind)
    mesh.topology.create_connectivity(dim - 1, dim)
    mesh.topology.create_connectivity(dim, dim - 1)
    names = {name: tag for name, (tag,) in data.cells.names.items()}
    regions = Regions(of_cells(mesh, corners, data.cells.groups).astype(np.int32), names)
    return Distributed(mesh, regions, _named_facets(mesh, data, row))


def of_cells(mesh: dmesh.Mesh, corners: IntArray, values: IntArray) -> IntArray:
    """The values (k,) of local cells, of which rank 0 has those of all cells; collective.

    ``corners`` (m, c) are the cells of this rank, as numbers of the points of `mesh_of`.
    """
    # Floating-point numbers hold whole ones up to 2^53, which int32 may not.
    tags = _tags(mesh, mesh.topology.dim, corners, values.astype(float))
    return tags.values[np.argsort(tags.indices)].astype(np.int64)


def _tags(mesh: dmesh.Mesh, dim: int, nodes: IntArray, values: Any) -> dmesh.MeshTags:
    """The values of entities, given by their nodes on any rank, as tags; collective."""
    entities, local = distribute_entity_data(mesh, dim, nodes, values)
    return dmesh.meshtags_from_entities(mesh, dim, graph.adjacencylist(entities), local)


def mesh_of(comm: MPI.Intracomm, points: FloatArray, cells: IntArray, kind: CellKind) -> dmesh.Mesh:
    """The mesh of cells (k, c) of a kind, as numbers of points (m, d); collective.

    Each rank has a share of the cells and of the points, which are numbered rank after rank.  The
    share may be empty.
    """
    shape = (kind.dim,)
    element = basix.ufl.element("Lagrange", kind.name, 1, shape=shape, dtype=default_real_type)
    # Keyword arguments, because DOLFINx 0.10 changed the order.
    with _one_partitioning_thread():
        return dmesh.create_mesh(
            comm=comm, cells=cells, x=points.astype(default_real_type), e=ufl.Mesh(element)
        )


@contextmanager
def _one_partitioning_thread() -> Iterator[None]:
    """SCOTCH partitions with one thread unless the user's environment says otherwise.

    The parts that several threads find depend on their timing.
    """
    if _SCOTCH_THREADS in os.environ:
        yield
        return
    os.environ[_SCOTCH_THREADS] = "1"
    try:
        yield
    finally:
        del os.environ[_SCOTCH_THREADS]


def _named_facets(mesh: dmesh.Mesh, data: MeshData, row: IntArray) -> dict[str, BoolArray]:
    """The marks of the facets of each name; ``row`` are the numbers of points; collective."""
    facets = data.facets
    every, number = np.unique(np.sort(row[facets.nodes], axis=1), axis=0, return_inverse=True)
    tags = _tags(mesh, data.dim - 1, every, np.arange(len(every), dtype=np.int32))
    named = {}
    for name in facets.names:
        rows = mesh.comm.bcast(np.unique(number.reshape(-1)[facets.named(name)]))
        named[name] = marked_facets(mesh, tags.indices[np.isin(tags.values, rows)])
    return named


def connected_parts(mesh: dmesh.Mesh) -> tuple[IndexArray, int]:
    """The connected part (k,) of each local cell, and how many parts there are; collective.

    Cells of one part are joined by facets.  The parts are numbered by the cells that come first in
    the mesh that was given.
    """
    topology, comm, dim = mesh.topology, mesh.comm, mesh.topology.dim
    cells, facets = topology.index_map(dim), topology.index_map(dim - 1)
    joint = topology.connectivity(dim - 1, dim)
    counts = np.diff(joint.offsets)
    pairs = joint.array[np.repeat(counts == 2, counts)].reshape(-1, 2)
    local_count, local = components(pairs, cells.size_local + cells.num_ghosts)
    every = comm.allgather(local_count)
    local = local + sum(every[: comm.rank])

    def part_of(some: IntArray) -> IntArray:
        return local[joint.array[joint.offsets[some]]]

    # A facet that two ranks have joins their parts: one of them knows it as a ghost.
    ghosts = np.arange(facets.size_local, facets.size_local + facets.num_ghosts)
    theirs = np.column_stack([facets.ghosts, part_of(ghosts)])
    shared = np.concatenate(comm.allgather(theirs))
    rows = shared[:, 0] - facets.local_range[0]
    is_own = (rows >= 0) & (rows < facets.size_local)
    edges = np.column_stack([part_of(rows[is_own]), shared[is_own, 1]])
    count, whole = components(np.concatenate(comm.allgather(edges)), sum(every))
    numbers = whole[local]
    first = np.full(count, np.iinfo(np.int64).max)
    np.minimum.at(first, numbers, np.asarray(topology.original_cell_index, dtype=np.int64))
    first = np.min(comm.allgather(first), axis=0)
    return np.argsort(np.argsort(first))[numbers].astype(np.int32), count
