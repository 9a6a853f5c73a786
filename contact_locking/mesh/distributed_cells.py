"""The check of a distributed mesh, of which no rank has the whole.

1. Each rank checks the shapes of its own cells.
2. For each facet, the cells of all ranks that share the facet are counted, and the sides on which
   the cells lie are added up: the sum is 0 where two cells lie on different sides.
3. The connected parts of the cells of each rank are joined where a facet has cells of two ranks.
4. The boundary, which is small beside the body, is checked on one rank.

Messages count nodes and cells from 0, in the order of the file.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from dolfinx import mesh as dmesh
from mpi4py import MPI

from contact_locking import _compat
from contact_locking.arrays import FloatArray, IndexArray, IntArray
from contact_locking.errors import InputError
from contact_locking.mesh.cell_kind import NAMED, CellKind
from contact_locking.mesh.file import places
from contact_locking.mesh.file.contiguity import check_boundary
from contact_locking.mesh.file.data import MeshData, MeshElements
from contact_locking.mesh.file.diagnosis import MOST_PARTS, check_cells, check_coordinates
from contact_locking.mesh.file.topology import components, keys, signed_measures
from contact_locking.mesh.rank_sums import summed
from contact_locking.parallel import agree, maximum, on_any_rank, on_root

# The largest z of a body in the plane, as a share of the largest coordinate.
_FLAT = 1e-12


@dataclass(frozen=True)
class MeshShare:
    """A rank's share of the points (m, dim or 3) and of the cells (k, c) of a mesh.

    Points and cells are numbered from 0, rank after rank; cells name points of all ranks.  DOLFINx
    needs numbers of nodes that are there, cells that occur once, and facets of two cells.
    """

    comm: MPI.Intracomm
    kind: CellKind
    points: FloatArray
    cells: IntArray

    def check(self) -> None:
        """Raise InputError, on all ranks, for arrays that are no mesh of a body; collective."""
        comm, kind, dim = self.comm, self.kind, self.kind.dim
        if not comm.allreduce(len(self.cells)):
            raise InputError("the mesh has no cells")
        first, first_cell = (comm.exscan(len(rows)) or 0 for rows in (self.points, self.cells))
        total = comm.allreduce(len(self.points))
        agree(comm, lambda: self._check_numbers(first, first_cell, total))
        if self.points.shape[1] > dim:
            flat = _FLAT * maximum(comm, np.abs(self.points))
            if on_any_rank(comm, np.abs(self.points[:, dim:]) > flat):
                raise InputError("the mesh is a surface in space; a 2D body lies in z = 0")
        cells = self._in_charge_of(np.sort(self.cells, axis=1), total)
        agree(comm, lambda: _require_once(cells, total, kind))
        facets = np.sort(kind.facets_of(self.cells), axis=1)
        shared = self._in_charge_of(facets, total)
        agree(comm, lambda: _require_two_cells(shared, total, kind))

    def _check_numbers(self, first: int, first_cell: int, total: int) -> None:
        """Raise InputError for a point that is not finite, and for a cell without its corners."""
        points, cells, dim = self.points, self.cells, self.kind.dim
        if cells.shape[1:] != (self.kind.corners,) or points.shape[1:] not in ((dim,), (3,)):
            raise InputError(
                f"the sizes of its arrays are not those of a mesh of {self.kind.plural}"
            )
        none = MeshElements(np.empty((0, dim), int), np.empty(0, int), np.empty(0, int), {})
        numbers = np.arange(first, first + len(points))
        check_coordinates(MeshData(dim, points, numbers, none, none))
        outside = ((cells < 0) | (cells >= total)).any(axis=1)
        corners = np.sort(cells, axis=1)
        twice = (corners[:, 1:] == corners[:, :-1]).any(axis=1)
        for bad, what in (
            (outside, f"names nodes that are none of its {total}"),
            (twice, "has the same node twice"),
        ):
            if bad.any():
                place = first_cell + int(np.argmax(bad))
                many = places.more(int(bad.sum()))
                raise InputError(f"{self.kind.name} {place} {what}{many}")

    def _in_charge_of(self, rows: IntArray, total: int) -> IntArray:
        """The rows of all ranks whose first node this rank is in charge of; collective."""
        size = self.comm.size
        if size == 1:
            return rows
        rank = rows[:, 0] * size // total
        order = np.argsort(rank, kind="stable")
        ends = np.searchsorted(rank[order], np.arange(1, size))
        return np.concatenate(self.comm.alltoall(np.split(rows[order], ends)))


def _require_once(cells: IntArray, total: int, kind: CellKind) -> None:
    _, first, number = np.unique(keys(cells, total), return_index=True, return_counts=True)
    if np.any(number > 1):
        nodes = _listed(cells[first[np.argmax(number > 1)]])
        raise InputError(
            f"a {kind.name} is there twice: both have the nodes {nodes}"
            f"{places.more(int(np.count_nonzero(number > 1)))}; remove the duplicates"
        )


def _require_two_cells(facets: IntArray, total: int, kind: CellKind) -> None:
    _, first, number = np.unique(keys(facets, total), return_index=True, return_counts=True)
    if np.any(number > 2):
        where = int(np.argmax(number > 2))
        what = "edge" if kind.dim == 2 else "face"
        raise InputError(
            f"{number[where]} {kind.plural} share one {what} "
            f"(nodes {_listed(facets[first[where]])}){places.more(int(np.sum(number > 2)))}; "
            "at most two can, as cells do not overlap"
        )


def _listed(nodes: IntArray) -> str:
    *most, last = map(str, nodes)
    return f"{', '.join(most)} and {last}"


class DistributedCells:
    """The owned cells (k, c) of a mesh, with sums over the cells of all ranks at facets.

    ``data`` has the points and the owned cells of this rank, with their numbers in the file.
    ``facets`` (k, n) are the local facets of the cells in the order of `CellKind`.
    ``shared`` (f,) is the number of cells of each local facet, and ``sides`` (f,) the sum of the
    sides, 1 or -1, on which these cells lie.  The constructor is collective.
    """

    def __init__(self, mesh: dmesh.Mesh) -> None:
        topology, self.dim = mesh.topology, int(mesh.topology.dim)
        self._mesh, self.comm = mesh, mesh.comm
        topology.create_connectivity(self.dim - 1, self.dim)
        topology.create_connectivity(self.dim, self.dim - 1)
        self._map = topology.index_map(self.dim - 1)
        owned = topology.index_map(self.dim).size_local
        facets = topology.connectivity(self.dim, self.dim - 1).array
        self._kind = NAMED[topology.cell_name()]
        self.facets = facets.reshape(-1, len(self._kind.facets))[:owned]
        numbers = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)
        self.data = MeshData(
            self.dim,
            np.array(mesh.geometry.x[:, : self.dim]),
            numbers,
            _unnamed(
                np.asarray(_compat.cell_nodes(mesh)[:owned], dtype=np.int64),
                np.asarray(topology.original_cell_index[:owned], dtype=np.int64),
            ),
            _unnamed(
                np.empty((0, self._kind.facet.corners), dtype=np.int64), np.empty(0, dtype=np.int64)
            ),
        )
        both = np.stack([np.ones_like(self.facets, dtype=float), self._signs()], axis=2)
        sums = summed(self._map, self.facets, both)
        self.shared: IntArray = np.rint(sums[:, 0]).astype(np.int64)
        self.sides: IntArray = np.rint(sums[:, 1]).astype(np.int64)

    def corners(self, cells: IntArray, sides: IntArray) -> IntArray:
        """The nodes (m, n) of the facets number ``sides`` (m,) of cells (m,)."""
        return self.data.cells.nodes[cells[:, None], np.array(self._kind.facets)[sides]]

    @cached_property
    def parts(self) -> tuple[int, IntArray]:
        """The number of connected parts of the body, and the part (k,) of each cell; collective.

        The parts are in the order of their first cells in the file.
        """
        parts, found = connected_parts(self._mesh)
        if found > MOST_PARTS:
            raise InputError(
                f"the body falls into {found} parts that share no edges or faces; at most "
                f"{MOST_PARTS} are allowed"
            )
        return found, parts[: len(self.facets)].astype(np.int64)

    def check(self) -> list[str]:
        """The warnings about the mesh; collective.  Raises InputError if it cannot be a body."""
        found: list[str] = []
        # Of a small mesh a rank may have no cells.
        agree(self.comm, lambda: check_cells(self.data, found) if len(self.facets) else None)
        # Of the cells of all ranks that cause the same warning the first rank names one.
        warnings: list[str] = next(filter(None, self.comm.allgather(found)), [])
        agree(self.comm, self._check_folds)
        return [*warnings, *self._warnings_about_boundary()]

    def _check_folds(self) -> None:
        folded = (self.shared[self.facets] == 2) & (self.sides[self.facets] != 0)
        if folded.any():
            cell, side = (index[:1] for index in np.nonzero(folded))
            corners = self.corners(cell, side)[0]
            raise InputError(
                f"{places.cell(self.data, int(cell[0]))} and its neighbour overlap: they lie on "
                f"one side of what they share ({places.nodes(self.data, corners)}); one of "
                "them is turned over"
            )

    def _warnings_about_boundary(self) -> list[str]:
        """Check that neighbours share nodes, with the boundary of the body on rank 0; collective.

        Raises InputError where parts touch without shared nodes, or a node hangs on a facet.
        """
        cells, sides = np.nonzero(self.shared[self.facets] == 1)
        corners = self.corners(cells, sides)
        local = (
            self.data.cells.numbers[cells] * len(self._kind.facets) + sides,
            self.data.numbers[corners],
            self.data.points[corners],
            self.parts[1][cells],
        )
        gathered = [self.comm.gather(np.ascontiguousarray(values)) for values in local]

        def judge() -> list[str]:
            whole = [np.concatenate(values) for values in gathered if values is not None]
            order = np.argsort(whole[0])
            keys, numbers, points, parts = (values[order] for values in whole)
            nodes, first, inverse = np.unique(numbers, return_index=True, return_inverse=True)
            owners = keys // len(self._kind.facets)
            nowhere = np.zeros((len(owners), self._kind.corners), dtype=np.int64)
            boundary = MeshData(
                self.dim,
                points.reshape(-1, self.dim)[first],
                nodes,
                _unnamed(nowhere, owners),
                self.data.facets,
            )
            warnings: list[str] = []
            facets = inverse.reshape(-1, self._kind.facet.corners)
            check_boundary(boundary, facets, np.arange(len(owners)), parts, warnings)
            return warnings

        return on_root(self.comm, judge)

    def _signs(self) -> FloatArray:
        """(k, n) the side of each facet of each cell on which the cell lies, 1 or -1.

        The nodes of the facet, in the order of their numbers in the file, orient the facet.
        """
        signs = np.empty(self.facets.shape)
        cells = np.arange(len(signs))
        for side, off in enumerate(self._kind.opposite):
            corners = self.corners(cells, np.full(len(cells), side))
            order = np.argsort(self.data.numbers[corners], axis=1)
            ordered = np.take_along_axis(corners, order, axis=1)[:, : self.dim]
            simplices = np.column_stack([ordered, self.data.cells.nodes[:, off]])
            signs[:, side] = np.sign(signed_measures(self.data.points, simplices))
        return signs


def _unnamed(nodes: IntArray, numbers: IntArray) -> MeshElements:
    return MeshElements(nodes, numbers, np.zeros(len(nodes), dtype=np.int64), {})


def box(comm: MPI.Intracomm, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The least and the greatest coordinates (d,) of the points of all ranks; collective."""
    low = comm.allgather(points.min(axis=0, initial=np.inf))
    high = comm.allgather(points.max(axis=0, initial=-np.inf))
    return np.min(low, axis=0), np.max(high, axis=0)


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
    found, local = components(pairs, cells.size_local + cells.num_ghosts)
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
    count, whole = components(np.concatenate(comm.allgather(edges)), sum(every))
    numbers = whole[local]
    first = np.full(count, np.iinfo(np.int64).max)
    np.minimum.at(first, numbers, np.asarray(topology.original_cell_index, dtype=np.int64))
    first = np.min(comm.allgather(first), axis=0)
    return np.argsort(np.argsort(first))[numbers].astype(np.int32), count
