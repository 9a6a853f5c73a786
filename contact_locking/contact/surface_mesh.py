"""Gamma_C as one mesh on every rank, with the distances between its nodes.

Distances are measured along Gamma_C.  Two parts that are near in space but not connected, and two
sides of a fold, are therefore far apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from contact_locking.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

# Nodes whose distance is the radius up to this share are all outside, whatever the rounding.
_ROUNDING = 1e-12
# The distances from so many nodes are in memory as a full matrix at a time.
_ROWS = 256

#: Some own nodes, other nodes, and their distances.
Pairs = tuple[IntArray, IntArray, FloatArray]


@dataclass(frozen=True)
class SurfaceMesh:
    """The nodes of Gamma_C with their weights, and its facets; made by ``ContactSurface.whole``.

    ``points`` (k, d), ``weights`` (k,) and ``facets`` (m, d), as numbers of nodes, are the same on
    every rank; ``own`` is the range of the nodes that this rank owns.  ``axisymmetric`` says that
    the points (r, z) stand for circles.
    """

    points: FloatArray
    weights: FloatArray
    facets: IntArray
    own: slice
    axisymmetric: bool = False

    @cached_property
    def edges(self) -> csr_matrix:
        """The lengths of the edges between nodes, as a symmetric matrix (k, k)."""
        from scipy.sparse import csr_matrix

        dim = self.points.shape[1]
        ends = [self.facets[:, [i, j]] for i in range(dim) for j in range(i)]
        pairs = np.unique(np.sort(np.concatenate(ends), axis=1), axis=0)
        lengths = np.linalg.norm(np.diff(self.points[pairs], axis=1)[:, 0], axis=1)
        shape = (len(self.points), len(self.points))
        upper = csr_matrix((lengths, (pairs[:, 0], pairs[:, 1])), shape=shape)
        return (upper + upper.T).tocsr()

    @cached_property
    def parts(self) -> IntArray:
        """(k,) the number of the connected part of Gamma_C on which each node lies."""
        from scipy.sparse.csgraph import connected_components

        return np.asarray(connected_components(self.edges, directed=False)[1], dtype=np.int64)

    def mean_by_part(self, values: FloatArray, weights: FloatArray | None = None) -> FloatArray:
        """(k,) the mean of ``values`` (k,) over the connected part of each node.

        ``weights`` (k,) are the weights of the mean, by default equal.
        """
        weights = np.ones(len(values)) if weights is None else weights
        total = np.bincount(self.parts, weights)
        sums = np.bincount(self.parts, weights * values)
        means = np.divide(sums, total, out=np.zeros_like(sums), where=total > 0.0)
        return np.asarray(means[self.parts])

    def within(self, radius: float) -> Iterator[Pairs]:
        """All p pairs of an own node and a node nearer than ``radius``, some own nodes at a time.

        Yields the numbers of own nodes, in their order, the numbers of the other nodes, and the
        distances, (p,) each.  All pairs together may take more memory than a solve.

        In 2D the distance is the length of the curve between the nodes.  In 3D the distance is the
        length of the straight line, for nodes that are connected within the ball of that radius
        around the own node: a fold of the surface that is near in space only does not count.  On a
        curved surface the straight line is shorter than the geodesic by the relative amount
        ``(radius * curvature)^2/24``.
        """
        near = self._along_curves if self.points.shape[1] == 2 else self._inside_balls
        for row, column, distance in near(radius):
            inside = distance < radius * (1.0 - _ROUNDING)
            yield row[inside], column[inside], distance[inside]

    def _along_curves(self, radius: float) -> Iterator[Pairs]:
        from scipy.sparse.csgraph import dijkstra

        first, last, _ = self.own.indices(len(self.points))
        for start in range(first, last, _ROWS):
            some = np.arange(start, min(start + _ROWS, last))
            lengths = dijkstra(self.edges, directed=False, indices=some, limit=radius)
            row, column = np.nonzero(np.isfinite(lengths))
            yield row + start - first, column, lengths[row, column]

    def _inside_balls(self, radius: float) -> Iterator[Pairs]:
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree

        first, last, _ = self.own.indices(len(self.points))
        tree = cKDTree(self.points)
        for node in range(first, last):
            ball = tree.query_ball_point(self.points[node], radius, return_sorted=True)
            column = np.asarray(ball, dtype=np.int64)
            _, piece = connected_components(self.edges[column][:, column], directed=False)
            column = column[piece == piece[np.searchsorted(column, node)]]
            lengths = np.linalg.norm(self.points[column] - self.points[node], axis=1)
            yield np.full(len(column), node - first), column, lengths
