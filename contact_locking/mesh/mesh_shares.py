"""The check of a mesh that lies on all ranks in shares of its arrays, before DOLFINx makes a mesh.

DOLFINx needs numbers of nodes that are there, cells that occur once, and facets of two cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.mesh.file import places
from contact_locking.mesh.file.data import MeshData, Simplices
from contact_locking.mesh.file.diagnosis import check_coordinates
from contact_locking.mesh.file.topology import keys
from contact_locking.parallel import agree, maximum, on_any_rank

# The largest z of a body in the plane, as a share of the largest coordinate.
_FLAT = 1e-12


@dataclass(frozen=True)
class MeshShare:
    """A rank's share of the points (m, dim or 3) and of the cells (k, dim + 1) of a mesh.

    Points and cells are numbered from 0, rank after rank; cells name points of all ranks.
    """

    comm: MPI.Intracomm
    dim: int
    points: FloatArray
    cells: IntArray

    def check(self) -> None:
        """Raise InputError, on all ranks, for arrays that are no mesh of a body; collective."""
        comm, dim = self.comm, self.dim
        if not comm.allreduce(len(self.cells)):
            raise InputError("the mesh has no cells")
        first, first_cell = (comm.exscan(len(rows)) or 0 for rows in (self.points, self.cells))
        total = comm.allreduce(len(self.points))
        agree(comm, lambda: self._check_numbers(first, first_cell, total))
        if self.points.shape[1] > dim:
            flat = _FLAT * maximum(comm, np.abs(self.points))
            if on_any_rank(comm, np.abs(self.points[:, dim:]) > flat):
                raise InputError("the mesh is a surface in space; a 2D body lies in z = 0")
        corners = np.sort(self.cells, axis=1)
        cells = self._in_charge_of(corners, total)
        agree(comm, lambda: _require_once(cells, total, dim))
        facets = np.concatenate([np.delete(corners, i, axis=1) for i in range(dim + 1)])
        shared = self._in_charge_of(facets, total)
        agree(comm, lambda: _require_two_cells(shared, total, dim))

    def _check_numbers(self, first: int, first_cell: int, total: int) -> None:
        """Raise InputError for a point that is not finite, and for a cell that is no simplex."""
        points, cells, dim = self.points, self.cells, self.dim
        if cells.shape[1:] != (dim + 1,) or points.shape[1:] not in ((dim,), (3,)):
            raise InputError("the sizes of its arrays are not those of a mesh of simplices")
        none = Simplices(np.empty((0, dim), int), np.empty(0, int), np.empty(0, int), {})
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
                raise InputError(f"{places.CELL[dim]} {place} {what}{many}")

    def _in_charge_of(self, rows: IntArray, total: int) -> IntArray:
        """The rows of all ranks whose first node this rank is in charge of; collective."""
        size = self.comm.size
        if size == 1:
            return rows
        rank = rows[:, 0] * size // total
        order = np.argsort(rank, kind="stable")
        ends = np.searchsorted(rank[order], np.arange(1, size))
        return np.concatenate(self.comm.alltoall(np.split(rows[order], ends)))


def _require_once(cells: IntArray, total: int, dim: int) -> None:
    """Raise InputError for a cell that is there twice."""
    _, first, number = np.unique(keys(cells, total), return_index=True, return_counts=True)
    if np.any(number > 1):
        nodes = _listed(cells[first[np.argmax(number > 1)]])
        raise InputError(
            f"a {places.CELL[dim]} is there twice: both have the nodes {nodes}"
            f"{places.more(int(np.count_nonzero(number > 1)))}; remove the duplicates"
        )


def _require_two_cells(facets: IntArray, total: int, dim: int) -> None:
    """Raise InputError for a facet of more than two cells."""
    _, first, number = np.unique(keys(facets, total), return_index=True, return_counts=True)
    if np.any(number > 2):
        where = int(np.argmax(number > 2))
        what, plural = ("edge", "triangles") if dim == 2 else ("face", "tetrahedra")
        raise InputError(
            f"{number[where]} {plural} share one {what} (nodes {_listed(facets[first[where]])})"
            f"{places.more(int(np.count_nonzero(number > 2)))}; at most two can, as cells do not "
            "overlap"
        )


def _listed(nodes: IntArray) -> str:
    *most, last = map(str, nodes)
    return f"{', '.join(most)} and {last}"
