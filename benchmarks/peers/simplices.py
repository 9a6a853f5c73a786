"""Linear simplices of one isotropic material by NumPy alone: strains, stiffness, boundary."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from contact_locking.arrays import FloatArray

IntArray = npt.NDArray[np.integer[Any]]
Place = Callable[[FloatArray], Any]


class Body:
    """Linear simplices of one isotropic material: ``x`` (k, d), ``cells`` (c, d + 1).

    ``strain`` maps nodal displacements, flattened node by node, to strains cell by cell, as vectors
    of m = d (d + 1)/2 entries with the off-diagonal ones times sqrt(2); ``stiffness`` is the matrix
    of a(u, u).
    """

    def __init__(self, x: FloatArray, cells: IntArray, young: float, poisson: float) -> None:
        self.x, self.cells = x, cells
        self.dim = dim = x.shape[1]
        edges = x[cells[:, 1:]] - x[cells[:, :1]]
        self.volumes = np.abs(np.linalg.det(edges)) / math.factorial(dim)
        # The shape functions fall or rise by one along the edges from the first vertex.
        others = np.linalg.inv(edges)
        gradients = np.concatenate([-others.sum(axis=2, keepdims=True), others], axis=2)
        self.strain = self._strain(gradients, cells)
        self.stiffness = self._stiffness(self.strain, young, poisson)

    def facets(self, inside: Place) -> IntArray:
        """The facets (f, d) of the boundary all of whose vertices lie where ``inside`` says."""
        sides = [np.delete(self.cells, i, axis=1) for i in range(self.dim + 1)]
        facets, count = np.unique(
            np.sort(np.concatenate(sides), axis=1), axis=0, return_counts=True
        )
        return facets[(count == 1) & inside(self.x[facets]).all(axis=1)]

    def nodal_areas(self, facets: IntArray) -> FloatArray:
        """The weights (k,) of the vertex rule on some facets, zero at all other nodes."""
        edges = self.x[facets[:, 1:]] - self.x[facets[:, :1]]
        gram = np.einsum("fik,fjk->fij", edges, edges)
        areas = np.sqrt(np.linalg.det(gram)) / math.factorial(self.dim - 1)
        weights = np.zeros(len(self.x))
        np.add.at(weights, facets, (areas / self.dim)[:, None])
        return weights

    def shares_of_loads(self, facets: IntArray) -> FloatArray:
        """The integrals (k,) of the shape functions over some facets."""
        return self.nodal_areas(facets)

    def values(self, nodes: IntArray) -> sp.csc_matrix:
        """The matrix (k, n) from nodal values to the values that contact and friction limit."""
        shape = (len(nodes), len(self.x))
        return sp.csc_matrix((np.ones(len(nodes)), (np.arange(len(nodes)), nodes)), shape)

    def _stiffness(self, strain: sp.csc_matrix, young: float, poisson: float) -> sp.csc_matrix:
        """The matrix of a(u, u) from strains at points that have the weights ``volumes``."""
        shear = young / (2.0 * (1.0 + poisson))
        volumetric = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
        trace = np.r_[np.ones(self.dim), np.zeros(self.dim * (self.dim - 1) // 2)]
        law = 2.0 * shear * np.eye(len(trace)) + volumetric * np.outer(trace, trace)
        return (strain.T @ sp.kron(sp.diags(self.volumes), law) @ strain).tocsc()

    def _strain(self, gradients: FloatArray, nodes: IntArray) -> sp.csc_matrix:
        """Strains at p points from gradients (p, d, s) of the shape functions of nodes (p, s)."""
        dim, (count, shapes) = self.dim, nodes.shape
        rows = [(i, i) for i in range(dim)] + list(combinations(range(dim), 2))
        blocks = np.zeros((count, len(rows), shapes, dim))
        for row, (i, j) in enumerate(rows):
            weight = 0.5 if i == j else math.sqrt(0.5)
            blocks[:, row, :, i] += weight * gradients[:, j, :]
            blocks[:, row, :, j] += weight * gradients[:, i, :]
        width = shapes * dim
        dofs = (nodes[:, :, None] * dim + np.arange(dim)).reshape(count, width)
        columns = np.repeat(dofs, len(rows), axis=0)
        lines = np.repeat(np.arange(count * len(rows)), width)
        shape = (count * len(rows), len(self.x) * dim)
        return sp.csc_matrix((blocks.ravel(), (lines, columns.ravel())), shape=shape)
