"""A mesh that the user has made, as the domain of a problem."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from dolfinx import mesh as dmesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from contact_locking.arrays import BoolArray, IndexArray, IntArray
from contact_locking.errors import InputError
from contact_locking.mesh.domain import Domain, Where
from contact_locking.mesh.named_parts import marked, tags_of
from contact_locking.parallel import agree, on_any_rank
from contact_locking.plain_text import nearest

_SIMPLICES = (dmesh.CellType.triangle, dmesh.CellType.tetrahedron)


class NamedFacets:
    """Boundary parts by names: those of ``names``, which are values of ``tags``, and given facets.

    Every place of a problem is told by :meth:`add` before :meth:`domain` makes the domain.
    """

    def __init__(
        self,
        mesh: dmesh.Mesh,
        tags: dmesh.MeshTags | None = None,
        names: Mapping[str, int] | None = None,
    ) -> None:
        if mesh.topology.cell_type not in _SIMPLICES:
            raise InputError("must have triangles or tetrahedra as cells", "mesh")
        if mesh.geometry.cmap.degree != 1 or mesh.geometry.dim != mesh.topology.dim:
            raise InputError("must have flat cells that fill the space around them", "mesh")
        self._mesh, self._tags, self._names = mesh, tags, dict(names or {})
        dim = mesh.topology.dim
        mesh.topology.create_entities(dim - 1)
        mesh.topology.create_connectivity(dim - 1, dim)
        mesh.topology.create_connectivity(dim, dim - 1)
        self._places: dict[str, BoolArray] = {}
        if self._names and tags is None:
            raise InputError("needs the mesh tags whose values have the names", "tags")
        self._outside = marked(mesh, np.asarray(dmesh.exterior_facet_indices(mesh.topology)))

    def add(self, where: Where, key: str) -> tuple[str, ...]:
        """Tell of a place, and get its names; collective.

        Raises InputError with the key for a name that is not there, and for facets that are not on
        the boundary.
        """
        if isinstance(where, str):
            where = (where,)
        if len(where) and all(isinstance(name, str) for name in where):
            for name in where:
                self._put(name, self._named(name, key), key)
            return tuple(where)
        if len(where) == 2 and isinstance(where[0], dmesh.MeshTags):
            where = where[0].find(where[1])
        self._put(key, np.asarray(where, dtype=np.int32), key)
        return (key,)

    def domain(self) -> Domain:
        """The domain with these boundary parts; collective."""
        mesh, dim = self._mesh, self._mesh.topology.dim
        tags, names = tags_of(mesh, self._places)
        cells = mesh.topology.index_map(dim)
        every = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
        cell_tags = dmesh.meshtags(mesh, dim, every, np.zeros_like(every))
        numbers, count = _connected(mesh)
        part_names = tuple(f"part {i + 1} of the body" for i in range(count))
        return Domain(
            mesh,
            cell_tags,
            tags,
            numbers,
            {},
            names,
            part_names if count > 1 else ("the body",),
        )

    def _named(self, name: str, key: str) -> IndexArray:
        if name not in self._names:
            there = ", ".join(sorted(self._names)) or "none at all"
            raise InputError(
                f"no boundary part is named {name!r}{nearest(name, self._names)}; names has: "
                f"{there}",
                key,
            )
        assert self._tags is not None
        facets = np.asarray(self._tags.find(self._names[name]), dtype=np.int32)
        if not on_any_rank(self._mesh.comm, bool(len(facets))):
            raise InputError(f"no facet has the tag {self._names[name]} of {name!r}", key)
        return facets

    def _put(self, name: str, facets: IndexArray, key: str) -> None:
        marks = marked(self._mesh, facets)

        def check() -> None:
            if np.any(marks & ~self._outside):
                raise InputError("has facets that are not on the boundary of the mesh", key)

        agree(self._mesh.comm, check)
        self._places[name] = marks


def _connected(mesh: dmesh.Mesh) -> tuple[IndexArray, int]:
    """The connected part (k,) of each local cell, and how many parts there are; collective.

    Cells of one part are joined by facets.  The parts are numbered by the cells that come first in
    the mesh that was given.
    """
    topology, comm, dim = mesh.topology, mesh.comm, mesh.topology.dim
    cells, facets = topology.index_map(dim), topology.index_map(dim - 1)
    joint = topology.connectivity(dim - 1, dim)
    counts = np.diff(joint.offsets)
    pairs = joint.array[np.repeat(counts == 2, counts)].reshape(-1, 2)
    found, local = _components(pairs, cells.size_local + cells.num_ghosts)
    every = comm.allgather(found)
    local = local + sum(every[: comm.rank])

    def part_of(some: IntArray) -> IntArray:
        return local[joint.array[joint.offsets[some]]]

    # A facet that two ranks have joins their parts: one of them knows it as a ghost.
    ghosts = np.arange(facets.size_local, facets.size_local + facets.num_ghosts)
    theirs = np.column_stack([facets.ghosts, part_of(ghosts)])
    shared = np.concatenate(comm.allgather(theirs))
    own = shared[:, 0] - facets.local_range[0]
    is_own = (own >= 0) & (own < facets.size_local)
    edges = np.column_stack([part_of(own[is_own]), shared[is_own, 1]])
    count, whole = _components(np.concatenate(comm.allgather(edges)), sum(every))
    numbers = whole[local]
    first = np.full(count, np.iinfo(np.int64).max)
    np.minimum.at(first, numbers, np.asarray(topology.original_cell_index, dtype=np.int64))
    first = np.min(comm.allgather(first), axis=0)
    return np.argsort(np.argsort(first))[numbers].astype(np.int32), count


def _components(pairs: IntArray, size: int) -> tuple[int, IntArray]:
    """The number of components of a graph with so many nodes, and that (size,) of each node."""
    entries = np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])
    count, numbers = connected_components(coo_matrix(entries, shape=(size, size)), directed=False)
    return int(count), np.asarray(numbers, dtype=np.int64)
