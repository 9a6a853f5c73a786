"""Boxes of degree 1 by NumPy alone, with 2 points of Gauss in each direction."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from simplices import Body

from contact_locking.arrays import FloatArray

IntArray = npt.NDArray[np.integer[Any]]


def corners_of(dim: int) -> IntArray:
    """The corners (2^d, d) of a box of length 1, by binary digits."""
    return np.array([[i >> axis & 1 for axis in range(dim)] for i in range(1 << dim)])


class Boxes(Body):
    """Quadrilaterals or hexahedra: ``x`` (k, d), ``cells`` (c, n) with their corners.

    ``volumes`` are the weights of the points of Gauss, cell by cell, as many as corners, each
    beside its corner; ``strain`` maps nodal displacements to the strains there.  ``shapes`` (n, n)
    are the shape functions at the points of a cell.
    """

    def __init__(self, x: FloatArray, cells: IntArray) -> None:
        self.x, self.cells = x, cells
        self.dim = dim = x.shape[1]
        corners = corners_of(dim)
        points = 0.5 + (corners - 0.5) * math.sqrt(1.0 / 3.0)
        # (q, n, d): the factors of the shape functions, whose slopes are 1 or -1.
        factors = np.where(corners == 1, points[:, None], 1.0 - points[:, None])
        self.shapes = factors.prod(axis=2)
        along = [
            (2 * corners[:, axis] - 1) * np.delete(factors, axis, axis=2).prod(axis=2)
            for axis in range(dim)
        ]
        jacobians = np.einsum("aqc,kcd->kqda", np.array(along), x[cells])
        gradients = np.einsum("aqc,kqad->kqdc", np.array(along), np.linalg.inv(jacobians))
        self.volumes = np.abs(np.linalg.det(jacobians)).ravel() / len(corners)
        each = np.repeat(cells, len(corners), axis=0)
        self.strain: sp.csc_matrix = self._strain(gradients.reshape(-1, dim, len(corners)), each)

    def nodal_areas(self, facets: IntArray) -> FloatArray:
        """A share of each facet, a line or a parallelogram, for each of its nodes."""
        weights = np.zeros(len(self.x))
        edges = self.x[facets[:, 1:]] - self.x[facets[:, :1]]
        gram = np.einsum("fik,fjk->fij", edges[:, : self.dim - 1], edges[:, : self.dim - 1])
        areas = np.sqrt(np.linalg.det(gram))
        np.add.at(weights, facets, (areas / facets.shape[1])[:, None])
        return weights
