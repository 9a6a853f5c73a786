"""From a mesh as arrays on rank 0 to a DOLFINx mesh on all ranks."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import basix.ufl
import numpy as np
import ufl
from dolfinx import default_real_type, graph
from dolfinx import mesh as dmesh
from dolfinx.io.utils import distribute_entity_data
from mpi4py import MPI

from contact_locking.arrays import FloatArray, IndexArray, IntArray
from contact_locking.mesh.cell_kind import CellKind
from contact_locking.mesh.file.data import MeshData, MeshElements

_SCOTCH_THREADS = "SCOTCH_PTHREAD_NUMBER"


class Distributed(NamedTuple):
    """A mesh with the groups of cells and facets as tags, and the part (k,) of each local cell."""

    mesh: dmesh.Mesh
    cell_tags: Any
    facet_tags: Any
    parts: IndexArray


def distribute(
    comm: MPI.Intracomm,
    kind: CellKind,
    data: MeshData | None,
    facets: MeshElements | None,
    parts: IntArray,
) -> Distributed:
    """Distribute cells of a kind and named facets; collective.

    Only rank 0 has ``data``, ``facets`` and ``parts`` (k,), the part of each cell; the other ranks
    pass None and an empty array.  Nodes without a cell are left out.  The same mesh is distributed
    in the same way each time, so that solutions can be compared node by node.
    """
    dim = kind.dim
    curved = comm.bcast(data is not None and data.curved is not None)
    points: FloatArray = np.empty((0, dim))
    corners: IntArray = np.empty((0, kind.corners), dtype=np.int64)
    cells: IntArray = np.empty((0, len(kind.curved) if curved else kind.corners), dtype=np.int64)
    marked: IntArray = np.empty((0, kind.facet.corners), dtype=np.int64)
    values: IndexArray = np.empty(0, dtype=np.int32)
    marks: IndexArray = np.empty(0, dtype=np.int32)
    groups: IntArray = np.empty(0, dtype=np.int64)
    if data is not None and facets is not None:
        nodes = data.cells.nodes if data.curved is None else data.curved
        used = np.zeros(len(data.points), dtype=bool)
        used[nodes] = True
        row = np.cumsum(used) - 1
        points, cells, marked = data.points[used], row[nodes], row[facets.nodes]
        corners = cells[:, : kind.corners]
        groups, index = np.unique(data.cells.groups, return_inverse=True)
        # One number encodes the part and the group of a cell.
        values = (parts * len(groups) + index).astype(np.int32)
        marks = facets.groups.astype(np.int32)
    groups = comm.bcast(groups)
    mesh = mesh_of(comm, points, cells, kind, degree=2 if curved else 1)
    mesh.topology.create_connectivity(dim, 0)
    both = _tags(mesh, dim, corners, values)
    order = np.argsort(both.indices)
    numbers, local = both.values[order], both.indices[order]
    cell_tags = dmesh.meshtags(mesh, dim, local, groups[numbers % len(groups)].astype(np.int32))
    mesh.topology.create_connectivity(dim - 1, dim)
    mesh.topology.create_connectivity(dim, dim - 1)
    facet_tags = _tags(mesh, dim - 1, marked, marks)
    return Distributed(mesh, cell_tags, facet_tags, (numbers // len(groups)).astype(np.int32))


def mesh_of(
    comm: MPI.Intracomm, points: FloatArray, cells: IntArray, kind: CellKind, degree: int = 1
) -> dmesh.Mesh:
    """The mesh of cells (k, c) of a kind, as numbers of points (m, d); collective.

    ``degree`` is that of the sides.  Each rank has a share of the cells and of the points, which
    are numbered rank after rank.  The share may be empty.
    """
    shape = (kind.dim,)
    element = basix.ufl.element("Lagrange", kind.name, degree, shape=shape, dtype=default_real_type)
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


def _tags(mesh: dmesh.Mesh, dim: int, entities: IntArray, values: IndexArray) -> Any:
    found, local = distribute_entity_data(mesh, dim, entities, values)
    return dmesh.meshtags_from_entities(
        mesh, dim, graph.adjacencylist(found), local.astype(np.int32, copy=False)
    )
