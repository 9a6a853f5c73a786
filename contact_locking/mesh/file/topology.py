"""The facets of cells, and the connected parts of a body."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.mesh.cell_kind import CellKind


def keys(rows: IntArray, count: int) -> npt.NDArray[Any]:
    """A sortable value for each row (k, d) of numbers below ``count``; equal rows, equal values."""
    width = rows.shape[1]
    if count**width < 2**63:
        return rows @ count ** np.arange(width - 1, -1, -1, dtype=np.int64)
    return np.ascontiguousarray(rows.astype(">u8")).view(f"V{8 * width}").ravel()


class Facets:
    """Every facet of cells (k, c) of a kind, once, with the cells that share it.

    ``nodes`` (f, n) are the nodes of each facet, sorted, and ``shared`` (f,) is the number of its
    cells.
    """

    def __init__(self, cells: IntArray, num_nodes: int, kind: CellKind) -> None:
        of_cells = kind.facets_of(cells)
        rows = np.sort(of_cells, axis=1)
        self._num_nodes = num_nodes
        values = keys(rows, num_nodes)
        order = np.argsort(values, kind="stable")
        values = values[order]
        first = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
        self._first, self._keys = first, values[first]
        self._cell = np.tile(np.arange(len(cells)), len(kind.facets))[order]
        self._opposite = cells[:, kind.opposite].T.ravel()[order]
        self._ordered = of_cells[order[first]]
        self.nodes: IntArray = rows[order[first]]
        self.shared: IntArray = np.diff(np.append(first, len(values)))

    def cells(self, facet: int) -> IntArray:
        """All cells of one facet."""
        start = self._first[facet]
        return self._cell[start : start + self.shared[facet]]

    def pairs(self, facets: IntArray) -> tuple[IntArray, IntArray]:
        """The first two cells (k, 2) of k facets, and a node (k, 2) of each off the facet."""
        both = self._first[facets][:, None] + [0, 1]
        return self._cell[both], self._opposite[both]

    def ordered(self, facets: IntArray) -> IntArray:
        """The nodes (k, n) of k facets in the order of `CellKind`."""
        return self._ordered[facets]

    def owner(self, facets: IntArray) -> IntArray:
        """The first cell (k,) of k facets."""
        return self._cell[self._first[facets]]

    def find(self, rows: IntArray) -> IntArray:
        """The facets (k,) with these nodes (k, n), in any order; -1 without such a facet."""
        wanted = keys(np.sort(rows, axis=1), self._num_nodes)
        places = np.minimum(np.searchsorted(self._keys, wanted), len(self._keys) - 1)
        return np.where(self._keys[places] == wanted, places, -1)


def components(pairs: IntArray, size: int) -> tuple[int, IntArray]:
    """The number of components of a graph with so many nodes, and that (size,) of each node.

    ``pairs`` (k, 2) are the nodes that are joined.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (size, size))
    count, numbers = connected_components(graph, directed=False)
    return int(count), numbers.astype(np.int64)


def signed_measures(points: FloatArray, simplices: IntArray) -> FloatArray:
    """``d!`` times the signed volume (k,) of simplices (k, d + 1)."""
    origin = points[simplices[:, -1]]
    edges = [points[simplices[:, i]] - origin for i in range(points.shape[1])]
    if len(edges) == 2:
        a, b = edges
        return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    a, b, c = edges
    return np.einsum("ki,ki->k", a, np.cross(b, c))


def longest_edges(points: FloatArray, cells: IntArray) -> FloatArray:
    """The longest distance (k,) of two corners of each cell (k, c)."""
    width = cells.shape[1]
    longest = np.zeros(len(cells))
    for i in range(width):
        for j in range(i):
            edge = points[cells[:, i]] - points[cells[:, j]]
            np.maximum(longest, np.einsum("ki,ki->k", edge, edge), out=longest)
    return np.sqrt(longest)
