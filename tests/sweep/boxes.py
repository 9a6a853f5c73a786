"""Bilinear and trilinear boxes by NumPy alone, with the 2 points of Gauss in each direction."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from simplices import Body

from contact_locking.arrays import FloatArray

IntArray = npt.NDArray[np.integer[Any]]


class Boxes(Body):
    """Quadrilaterals or hexahedra: ``x`` (k, d), ``cells`` (c, 2^d), corners by binary digits.

    ``volumes`` are the weights of the points of Gauss, cell by cell, and ``strain`` maps nodal
    displacements to the strains there.  ``shapes`` (2^d, 2^d) are the shape functions at the points
    of a cell.
    """

    def __init__(self, x: FloatArray, cells: IntArray) -> None:
        self.x, self.cells = x, cells
        self.dim = dim = x.shape[1]
        corners = np.array([[i >> axis & 1 for axis in range(dim)] for i in range(1 << dim)])
        points = 0.5 + (corners - 0.5) / math.sqrt(3.0)
        # (q, c, d): the factors of the shape functions, and their slopes.
        factors = np.where(corners == 1, points[:, None], 1.0 - points[:, None])
        slopes = np.broadcast_to(2.0 * corners - 1.0, factors.shape)
        self.shapes = factors.prod(axis=2)
        along = [
            slopes[:, :, axis] * np.delete(factors, axis, axis=2).prod(axis=2)
            for axis in range(dim)
        ]
        jacobians = np.einsum("aqc,kcd->kqda", np.array(along), x[cells])
        gradients = np.einsum("aqc,kqad->kqdc", np.array(along), np.linalg.inv(jacobians))
        count = len(points)
        self.volumes = (np.abs(np.linalg.det(jacobians)) / count).ravel()
        nodes = np.repeat(cells, count, axis=0)
        self.strain: sp.csc_matrix = self._strain(gradients.reshape(-1, dim, count), nodes)

    def nodal_areas(self, facets: IntArray) -> FloatArray:
        """A share of each facet, a line or a parallelogram, for each of its corners."""
        weights = np.zeros(len(self.x))
        edges = self.x[facets[:, 1:]] - self.x[facets[:, :1]]
        gram = np.einsum("fik,fjk->fij", edges[:, : self.dim - 1], edges[:, : self.dim - 1])
        areas = np.sqrt(np.linalg.det(gram))
        np.add.at(weights, facets, (areas / facets.shape[1])[:, None])
        return weights
