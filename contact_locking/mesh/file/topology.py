"""Numbers for rows of nodes, sizes of cells, and the components of graphs."""

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
