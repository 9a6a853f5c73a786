"""Quadratic triangles with limits at the corners, for the conic programme of conic.py."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from simplices import Body, IntArray, Place

from contact_locking.arrays import FloatArray

#: The ends of the edges of a triangle.  Edge i is opposite to corner i; node 3 + i is its midpoint.
EDGES = np.array([[1, 2], [0, 2], [0, 1]])


class QuadraticBody(Body):
    """Straight triangles of degree 2: ``x`` (k, 2), ``cells`` (c, 6), the corners first.

    ``strain`` maps to the strains at the corners, cell by cell, and ``volumes`` (3 c,) are the
    weights of the corners, a third of each cell.  The strain is affine in a cell, so that
    ``stiffness`` is exact with the rule of the midpoints.
    """

    def __init__(self, x: FloatArray, cells: IntArray, young: float, poisson: float) -> None:
        corners = Body(x, cells[:, :3], young, poisson)
        self.x, self.cells, self.dim = x, cells, 2
        self.volumes = np.repeat(corners.volumes / 3.0, 3)
        edges = x[cells[:, 1:3]] - x[cells[:, :1]]
        others = np.linalg.inv(edges)
        slopes = np.concatenate([-others.sum(axis=2, keepdims=True), others], axis=2)
        self.strain = self._strain_at(slopes, np.eye(3))
        middles = self._strain_at(slopes, np.asarray((1.0 - np.eye(3)) / 2.0))
        self.stiffness = self._stiffness(middles, young, poisson)

    def facets(self, inside: Place) -> IntArray:
        """The facets (f, 3), a midpoint behind two ends, of which all three lie inside."""
        sides = np.concatenate([self.cells[:, [a, b, 3 + i]] for i, (a, b) in enumerate(EDGES)])
        _, first, count = np.unique(sides[:, 2], return_index=True, return_counts=True)
        outer = sides[first[count == 1]]
        return outer[inside(self.x[outer]).all(axis=1)]

    def nodal_areas(self, facets: IntArray) -> FloatArray:
        """The weights (k,) of the control values: Bernstein's functions have equal integrals."""
        return self._weights(facets, np.array([1.0, 1.0, 1.0]) / 3.0)

    def shares_of_loads(self, facets: IntArray) -> FloatArray:
        """The integrals (k,) of the shape functions, which are Simpson's weights."""
        return self._weights(facets, np.array([1.0, 1.0, 4.0]) / 6.0)

    def values(self, nodes: IntArray) -> sp.csc_matrix:
        """The control values: u at a corner, and ``2 u_m - (u_1 + u_2)/2`` at a midpoint m."""
        control = sp.lil_matrix(sp.eye(len(self.x)))
        for i, ends in enumerate(EDGES):
            middles = self.cells[:, 3 + i]
            control[middles, middles] = 2.0
            for end in ends:
                control[middles, self.cells[:, end]] = -0.5
        return control.tocsr()[nodes].tocsc()

    def _strain_at(self, slopes: FloatArray, places: FloatArray) -> sp.csc_matrix:
        """Strains at the places (3, 3), barycentric, with the gradients of those coordinates."""
        gradients = np.empty((len(self.cells), 3, 2, 6))
        for place in range(3):
            shares = places[place]
            gradients[:, place, :, :3] = (4.0 * shares - 1.0) * slopes
            for i, (a, b) in enumerate(EDGES):
                both = shares[a] * slopes[:, :, b] + shares[b] * slopes[:, :, a]
                gradients[:, place, :, 3 + i] = 4.0 * both
        return self._strain(gradients.reshape(-1, 2, 6), np.repeat(self.cells, 3, axis=0))

    def _weights(self, facets: IntArray, shares: FloatArray) -> FloatArray:
        lengths = np.linalg.norm(self.x[facets[:, 1]] - self.x[facets[:, 0]], axis=1)
        weights = np.zeros(len(self.x))
        np.add.at(weights, facets, lengths[:, None] * shares)
        return weights
