"""Continuous piecewise quadratic fields from affine fields in each cell, by patches of cells.

1. For each node at a corner of cells, the patch is the set of cells around the node.
2. A polynomial of degree 2 is fitted to the values of the affine fields at the points of Gauss's
   rule in the cells of the patch, by least squares.
3. The value at a corner is the value of its polynomial.  The value at the middle of an edge is the
   mean of the polynomials of both ends.

(Zienkiewicz and Zhu, doi:10.1002/nme.1620330702.)
"""

from __future__ import annotations

import itertools

import numpy as np
from dolfinx import fem, la
from dolfinx import mesh as dmesh
from scipy import sparse

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IndexArray, flattened
from contact_locking.fem import gauss_points

# The ends of the edges whose middles are nodes of a cell, after its corners, in DOLFINx's order.
EDGES = {2: ((1, 2), (0, 2), (0, 1)), 3: ((2, 3), (1, 3), (1, 2), (0, 3), (0, 2), (0, 1))}

# Where the points of a patch do not determine a quadratic polynomial, the quadratic terms vanish:
# their squares, with this factor, are added to the squares of the differences at the points.
_REGULARISATION = 1e-4


class PatchRecovery:
    """The recovery on the owned cells of a mesh, with ``count`` of them."""

    def __init__(self, mesh: dmesh.Mesh, count: int) -> None:
        self._mesh, self._dim = mesh, mesh.topology.dim
        self._corners: IndexArray = self._space(1).dofmap.list[:count]
        nodes = _compat.cell_nodes(mesh)[:count]
        self._x = mesh.geometry.x[nodes][:, :, : self._dim]
        shares = gauss_points.shares(self._dim)
        self._points = np.einsum("qc,kcd->kqd", shares, self._x)
        middles = [self._x[:, list(edge)].mean(axis=1) for edge in EDGES[self._dim]]
        self._nodes = np.concatenate([self._x, np.stack(middles, axis=1)], axis=1)

    def nodal(self, values: FloatArray, inside: BoolArray) -> FloatArray:
        """The recovered values (k, nodes, m) at the nodes of the cells ``inside`` (count,).

        ``values`` (k, d + 1, m) are those at the Gauss points of these cells.  Patches have cells
        inside alone.  Collective.
        """
        corners, size = self._corners[inside], self._sizes(inside)
        fits = self._fits(values, inside, size)
        result = np.zeros((len(values), self._nodes.shape[1], values.shape[2]))
        number = np.zeros(self._nodes.shape[1])
        for corner in range(self._dim + 1):
            edges = [corner in edge for edge in EDGES[self._dim]]
            at = np.flatnonzero([*(corner == other for other in range(self._dim + 1)), *edges])
            origin, scale = self._x[inside, None, corner], size[corners[:, corner], None, None]
            monomials = _monomials((self._nodes[inside][:, at] - origin) / scale)
            result[:, at] += np.einsum("knf,kfm->knm", monomials, fits[corners[:, corner]])
            number[at] += 1.0
        return result / number[:, None]

    def _sizes(self, inside: BoolArray) -> FloatArray:
        """(v,) the root mean square of the distances from each node to the points; collective."""
        apart = self._points[inside][:, :, None] - self._x[inside][:, None]
        squares = np.sum(apart**2, axis=(1, 3))
        sums = self._summed(
            np.stack([squares, np.full_like(squares, self._dim + 1)], axis=2), inside
        )
        return np.sqrt(sums[:, 0] / np.maximum(sums[:, 1], 1.0))

    def _fits(self, values: FloatArray, inside: BoolArray, size: FloatArray) -> FloatArray:
        """The coefficients (v, f, m) of the polynomials of the local nodes; collective."""
        corners, points = self._corners[inside], self._points[inside]
        terms = []
        for corner in range(self._dim + 1):
            origin, scale = self._x[inside, None, corner], size[corners[:, corner], None, None]
            monomials = _monomials((points - origin) / scale)
            both = np.concatenate([monomials, values], axis=2)
            terms.append(np.einsum("kqf,kqg->kfg", monomials, both))
        shape = terms[0].shape[1:]
        flat = np.stack([flattened(term) for term in terms], axis=1)
        sums = self._summed(flat, inside).reshape(-1, *shape)
        number = shape[0]
        normal, right = sums[:, :, :number], sums[:, :, number:]
        weight = np.zeros(number)
        weight[1 + self._dim :] = _REGULARISATION
        normal = normal + normal[:, :1, :1] * np.diag(weight)
        found = np.zeros_like(right)
        there = normal[:, 0, 0] > 0.0
        found[there] = np.linalg.solve(normal[there], right[there])
        return found

    def _summed(self, values: FloatArray, inside: BoolArray) -> FloatArray:
        """(v, m) the sums over the cells around each local node of values (k, d + 1, m)."""
        total = fem.Function(self._space(values.shape[2]))
        nodal = total.x.array.reshape(-1, values.shape[2])
        rows = self._corners[inside].reshape(-1)
        columns = np.arange(len(rows))
        ones = np.ones(len(rows))
        gather = sparse.csr_matrix((ones, (rows, columns)), shape=(len(nodal), len(rows)))
        nodal[:] = gather @ values.reshape(-1, values.shape[2])
        total.x.scatter_reverse(la.InsertMode.add)
        total.x.scatter_forward()
        return nodal.copy()

    def _space(self, size: int) -> fem.FunctionSpace:
        return fem.functionspace(self._mesh, ("P", 1, (size,)))


def _monomials(y: FloatArray) -> FloatArray:
    """1, the components, and their products: (k, n, f) for y (k, n, d)."""
    pairs = itertools.combinations_with_replacement(range(y.shape[2]), 2)
    squares = [y[:, :, i] * y[:, :, j] for i, j in pairs]
    return np.stack([np.ones(y.shape[:2]), *np.moveaxis(y, 2, 0), *squares], axis=2)
