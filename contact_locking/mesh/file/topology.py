"""The facets of cells, and the connected parts of a body."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from contact_locking.arrays import FloatArray, IntArray


def keys(rows: IntArray, count: int) -> npt.NDArray[Any]:
    """A sortable value for each row (k, d) of numbers below ``count``; equal rows, equal values."""
    width = rows.shape[1]
    if count**width < 2**63:
        return rows @ count ** np.arange(width - 1, -1, -1, dtype=np.int64)
    return np.ascontiguousarray(rows.astype(">u8")).view(f"V{8 * width}").ravel()


class Facets:
    """Every facet of cells (k, d + 1), once, with the cells that share it.

    ``nodes`` (f, d) are the nodes of each facet, sorted, and ``shared`` (f,) is the number of its
    cells.
    """

    def __init__(self, cells: IntArray, num_nodes: int) -> None:
        width = cells.shape[1]
        corners = np.sort(cells, axis=1)
        rows = np.concatenate([np.delete(corners, i, axis=1) for i in range(width)])
        self._num_nodes = num_nodes
        values = keys(rows, num_nodes)
        order = np.argsort(values, kind="stable")
        values = values[order]
        first = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
        self._first, self._keys = first, values[first]
        self._cell = np.tile(np.arange(len(cells)), width)[order]
        self._opposite = corners.T.ravel()[order]
        self.nodes: IntArray = rows[order[first]]
        self.shared: IntArray = np.diff(np.append(first, len(values)))

    def cells(self, facet: int) -> IntArray:
        """All cells of one facet."""
        start = self._first[facet]
        return self._cell[start : start + self.shared[facet]]

    def pairs(self, facets: IntArray) -> tuple[IntArray, IntArray]:
        """The first two cells (k, 2) of k facets, and the nodes (k, 2) opposite to the facets."""
        both = self._first[facets][:, None] + [0, 1]
        return self._cell[both], self._opposite[both]

    def owner(self, facets: IntArray) -> IntArray:
        """The first cell (k,) of k facets."""
        return self._cell[self._first[facets]]

    def find(self, rows: IntArray) -> IntArray:
        """The facets (k,) with these nodes (k, d), in any order; -1 without such a facet."""
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


def longest_edges(points: FloatArray, simplices: IntArray) -> FloatArray:
    """The longest edge (k,) of each simplex (k, d + 1)."""
    width = simplices.shape[1]
    longest = np.zeros(len(simplices))
    for i in range(width):
        for j in range(i):
            edge = points[simplices[:, i]] - points[simplices[:, j]]
            np.maximum(longest, np.einsum("ki,ki->k", edge, edge), out=longest)
    return np.sqrt(longest)
