"""The check of a distributed mesh, of which no rank has the whole.

1. Each rank checks the shapes of its own cells.
2. For each facet, the cells of all ranks that share the facet are counted, and the sides on which
   the cells lie are added up: the sum is 0 where two cells lie on different sides.
3. The connected parts of the cells of each rank are joined where a facet has cells of two ranks.
4. The boundary, which is small beside the body, is checked on one rank.

Messages count nodes and cells from 0, in the order of the file.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from dolfinx import la
from dolfinx import mesh as dmesh
from mpi4py import MPI

from contact_locking import _compat
from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.mesh.file import places
from contact_locking.mesh.file.contiguity import check_boundary
from contact_locking.mesh.file.data import MeshData, Simplices
from contact_locking.mesh.file.diagnosis import MOST_PARTS, check_cells
from contact_locking.mesh.file.topology import signed_measures
from contact_locking.parallel import agree, on_root


class DistributedCells:
    """The owned cells (k, d + 1) of a mesh, with sums over the cells of all ranks at facets.

    ``data`` has the points and the owned cells of this rank, with their numbers in the file.
    ``facets`` (k, d + 1) are the local facets of the cells; facet i is opposite to corner i.
    ``shared`` (f,) is the number of cells of each local facet, and ``sides`` (f,) the sum of the
    sides, 1 or -1, on which these cells lie.  The constructor is collective.
    """

    def __init__(self, mesh: dmesh.Mesh) -> None:
        topology, self.dim = mesh.topology, int(mesh.topology.dim)
        self.comm = mesh.comm
        topology.create_connectivity(self.dim - 1, self.dim)
        topology.create_connectivity(self.dim, self.dim - 1)
        self._map = topology.index_map(self.dim - 1)
        owned = topology.index_map(self.dim).size_local
        facets = topology.connectivity(self.dim, self.dim - 1).array
        self.facets = facets.reshape(-1, self.dim + 1)[:owned]
        numbers = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)
        self.data = MeshData(
            self.dim,
            np.array(mesh.geometry.x[:, : self.dim]),
            numbers,
            _unnamed(
                np.asarray(_compat.cell_nodes(mesh)[:owned], dtype=np.int64),
                np.asarray(topology.original_cell_index[:owned], dtype=np.int64),
            ),
            _unnamed(np.empty((0, self.dim), dtype=np.int64), np.empty(0, dtype=np.int64)),
        )
        both = np.stack([np.ones_like(self.facets, dtype=float), self._signs()], axis=2)
        sums = self.summed(both)
        self.shared: IntArray = np.rint(sums[:, 0]).astype(np.int64)
        self.sides: IntArray = np.rint(sums[:, 1]).astype(np.int64)

    def summed(self, values: FloatArray) -> FloatArray:
        """(f, m) the sums over the cells of all ranks of values (k, d + 1, m); collective."""
        size = values.shape[2]
        total = la.vector(self._map, size)
        at = total.array.reshape(-1, size)
        for column in range(size):
            at[:, column] = np.bincount(
                self.facets.reshape(-1), values[:, :, column].reshape(-1), len(at)
            )
        total.scatter_reverse(la.InsertMode.add)
        total.scatter_forward()
        return total.array.reshape(-1, size).copy()

    def corners(self, cells: IntArray, sides: IntArray) -> IntArray:
        """The nodes (m, d) of the facets opposite to the corners ``sides`` (m,) of cells (m,)."""
        others = np.array([np.delete(np.arange(self.dim + 1), i) for i in range(self.dim + 1)])
        return self.data.cells.nodes[cells[:, None], others[sides]]

    @cached_property
    def parts(self) -> tuple[int, IntArray]:
        """The number of connected parts of the body, and the part (k,) of each cell; collective.

        The parts are in the order of their first cells in the file.
        """
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        count = len(self.facets)
        place = self.facets.reshape(-1)
        cell = np.repeat(np.arange(count), self.dim + 1)
        order = np.argsort(place, kind="stable")
        twice = np.flatnonzero(np.diff(place[order]) == 0)
        ends = cell[order[twice]], cell[order[twice + 1]]
        graph = coo_array((np.ones(len(twice)), ends), (count, count))
        own, labels = connected_components(graph, directed=False)
        first = self.comm.exscan(own) or 0
        numbers = (labels + first).astype(np.int64)
        # Where another rank has the other cell of a facet, the sum tells the number of its part.
        here = np.bincount(place, minlength=len(self.shared))
        spread = np.repeat(numbers[:, None].astype(float), self.dim + 1, axis=1)
        sums = self.summed(spread[:, :, None])[:, 0]
        cut = ((self.shared == 2) & (here == 1))[place]
        pairs = np.column_stack(
            [numbers[cell[cut]], np.rint(sums[place[cut]]) - numbers[cell[cut]]]
        )
        pairs = np.concatenate(self.comm.allgather(np.unique(pairs.astype(np.int64), axis=0)))
        total = self.comm.allreduce(own)
        joint = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (total, total))
        found, of_number = connected_components(joint, directed=False)
        if found > MOST_PARTS:
            raise InputError(
                f"the body falls into {found} parts that share no edges or faces; at most "
                f"{MOST_PARTS} are allowed"
            )
        part = of_number[numbers]
        least = np.full(found, np.iinfo(np.int64).max)
        np.minimum.at(least, part, self.data.cells.numbers)
        rank = np.argsort(np.argsort(np.min(self.comm.allgather(least), axis=0)))
        return int(found), rank[part].astype(np.int64)

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
        """Raise InputError for two cells on one side of their common facet."""
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
            self.data.cells.numbers[cells] * (self.dim + 1) + sides,
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
            owners = keys // (self.dim + 1)
            nowhere = np.zeros((len(owners), self.dim + 1), dtype=np.int64)
            boundary = MeshData(
                self.dim,
                points.reshape(-1, self.dim)[first],
                nodes,
                _unnamed(nowhere, owners),
                self.data.facets,
            )
            warnings: list[str] = []
            facets = inverse.reshape(-1, self.dim)
            check_boundary(boundary, facets, np.arange(len(owners)), parts, warnings)
            return warnings

        return on_root(self.comm, judge)

    def _signs(self) -> FloatArray:
        """(k, d + 1) the side of each facet of each cell on which the cell lies, 1 or -1.

        The nodes of the facet, in the order of their numbers in the file, orient the facet.
        """
        signs = np.empty(self.facets.shape)
        cells = np.arange(len(signs))
        for side in range(self.dim + 1):
            corners = self.corners(cells, np.full(len(cells), side))
            order = np.argsort(self.data.numbers[corners], axis=1)
            opposite = self.data.cells.nodes[:, side]
            simplices = np.column_stack([np.take_along_axis(corners, order, axis=1), opposite])
            signs[:, side] = np.sign(signed_measures(self.data.points, simplices))
        return signs


def _unnamed(nodes: IntArray, numbers: IntArray) -> Simplices:
    return Simplices(nodes, numbers, np.zeros(len(nodes), dtype=np.int64), {})


def box(comm: MPI.Intracomm, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The least and the greatest coordinates (d,) of the points of all ranks; collective."""
    low = comm.allgather(points.min(axis=0, initial=np.inf))
    high = comm.allgather(points.max(axis=0, initial=-np.inf))
    return np.min(low, axis=0), np.max(high, axis=0)
