"""Boxes of degree 1 and 2 by NumPy alone, with 2 or 3 points of Gauss in each direction."""

from __future__ import annotations

import math
from itertools import combinations, product
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from simplices import Body

from contact_locking.arrays import FloatArray

IntArray = npt.NDArray[np.integer[Any]]

# Points of Gauss on [-1, 1] with their weights, by the number of nodes in a direction.
_GAUSS = {2: (math.sqrt(1.0 / 3.0), (0.5, 0.5)), 3: (math.sqrt(0.6), (5 / 18, 4 / 9, 5 / 18))}


def nodes_of(dim: int, degree: int) -> FloatArray:
    """The nodes (n, d) of a box: corners by binary digits, then middles of edges, faces, the box.

    Middles have the order of the corners around them.
    """
    corners = np.array([[i >> axis & 1 for axis in range(dim)] for i in range(1 << dim)])
    found = [corner.astype(float) for corner in corners]
    for free in range(1, dim + 1) if degree == 2 else ():
        around = []
        for axes in combinations(range(dim), free):
            rest = [axis for axis in range(dim) if axis not in axes]
            for ends in product((0, 1), repeat=dim - free):
                around.append(np.flatnonzero((corners[:, rest] == ends).all(axis=1)))
        found += [corners[some].mean(axis=0) for some in sorted(around, key=list)]
    return np.array(found)


def products(nodes: FloatArray, matrix: FloatArray) -> FloatArray:
    """(n, n) the products over the axes of the entries of nodes on a line, from end to end."""
    place = np.rint(nodes * (len(matrix) - 1)).astype(int)
    return np.asarray(matrix[place[:, None], place[None]].prod(axis=2))


class Boxes(Body):
    """Quadrilaterals or hexahedra: ``x`` (k, d), ``cells`` (c, n) with the nodes of a degree.

    ``volumes`` are the weights of the points of Gauss, cell by cell, as many as nodes, each beside
    its node; ``strain`` maps nodal displacements to the strains there.  ``shapes`` (n, n) are the
    shape functions at the points of a cell.
    """

    def __init__(self, x: FloatArray, cells: IntArray) -> None:
        self.x, self.cells = x, cells
        self.dim = dim = x.shape[1]
        count = cells.shape[1]
        line = round(count ** (1.0 / dim))
        nodes = nodes_of(dim, line - 1)
        reach, weights = _GAUSS[line]
        points = 0.5 + (nodes - 0.5) * reach
        ends = np.arange(line) / (line - 1)
        place = np.rint(nodes * (line - 1)).astype(int)
        # (q, n, d): the factors of the shape functions, and their slopes.
        factors, slopes = np.ones((2, count, count, dim))
        for axis in range(dim):
            for number, end in enumerate(ends):
                others = np.delete(ends, number)
                own = np.poly1d(others, r=True) / np.prod(end - others)
                some = place[:, axis] == number
                factors[:, some, axis] = own(points[:, None, axis])
                slopes[:, some, axis] = own.deriv()(points[:, None, axis])
        self.shapes = factors.prod(axis=2)
        along = [
            slopes[:, :, axis] * np.delete(factors, axis, axis=2).prod(axis=2)
            for axis in range(dim)
        ]
        jacobians = np.einsum("aqc,kcd->kqda", np.array(along), x[cells])
        gradients = np.einsum("aqc,kqad->kqdc", np.array(along), np.linalg.inv(jacobians))
        weight = np.array(weights)[place].prod(axis=1)
        self.volumes = (np.abs(np.linalg.det(jacobians)) * weight).ravel()
        each = np.repeat(cells, count, axis=0)
        self.strain: sp.csc_matrix = self._strain(gradients.reshape(-1, dim, count), each)

    def nodal_areas(self, facets: IntArray) -> FloatArray:
        """A share of each facet, a line or a parallelogram, for each of its nodes."""
        weights = np.zeros(len(self.x))
        edges = self.x[facets[:, 1:]] - self.x[facets[:, :1]]
        gram = np.einsum("fik,fjk->fij", edges[:, : self.dim - 1], edges[:, : self.dim - 1])
        areas = np.sqrt(np.linalg.det(gram))
        np.add.at(weights, facets, (areas / facets.shape[1])[:, None])
        return weights

    def controls(self, facets: IntArray) -> sp.csr_matrix:
        """The map (k, k) to the values of facets that contact limits: Bernstein's coefficients."""
        found = sp.eye(len(self.x), format="lil")
        if len(self.x) and facets.shape[1] > 1 << (self.dim - 1):
            line = np.array([[1.0, 0.0, 0.0], [-0.5, 2.0, -0.5], [0.0, 0.0, 1.0]])
            shares = products(nodes_of(self.dim - 1, 2), line)
            for facet in facets:
                found[facet[:, None], facet] = shares
        return found.tocsr()
