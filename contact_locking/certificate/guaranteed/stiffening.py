"""The body stiffened by zeta >= 0 where it locks: A + zeta in place of A.

For ``phi(e) = A e : e/2`` with ``|e| <= M`` the conjugate is

    phi*(s) = min over zeta >= 0 of (A + zeta)^-1 s : s/2 + zeta M^2/2,

so that every zeta gives an upper bound of phi*.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import la

from contact_locking.arrays import FloatArray, flattened
from contact_locking.certificate.guaranteed.triangles import Triangles

# Newton's method for zeta is monotone and ends with rounding; every value in between is a bound.
_STEPS = 30


@dataclass(frozen=True)
class Elasticity:
    """A on each triangle: the ``eigenvalues`` (n, 3) and the ``vectors`` (n, 3, 3), as columns."""

    eigenvalues: FloatArray
    vectors: FloatArray

    @classmethod
    def of(cls, stiffness: FloatArray) -> Elasticity:
        """From Mandel matrices (n, 3, 3)."""
        return cls(*np.linalg.eigh(stiffness))

    def compliance(self, zeta: FloatArray) -> FloatArray:
        """``(A + zeta)^-1`` as matrices (n, 3, 3) for zeta (n,)."""
        scaled = self.vectors / (self.eigenvalues + zeta[:, None])[:, None]
        return np.asarray(scaled @ np.swapaxes(self.vectors, 1, 2))

    def modes(self, tensors: FloatArray) -> FloatArray:
        """Components (n, 3, m, 3) of Mandel vectors (n, 3, m, 3) along the eigenvectors."""
        shape = tensors.shape
        return np.asarray(flattened(tensors, kept=1) @ self.vectors).reshape(shape)


def averaged(values: FloatArray, triangles: Triangles) -> FloatArray:
    """(n,) the means over the corners of the means over the cells around; collective.

    An average is better than the values of single cells, because Z alternates between the cells of
    a locked zone.
    """
    mesh = triangles.domain.mesh
    index_map = mesh.topology.index_map(0)
    corners = mesh.topology.connectivity(2, 0).array.reshape(-1, 3)[: len(values)]
    sums = la.vector(index_map, 2)
    sums.array[:] = 0.0
    nodal = sums.array.reshape(-1, 2)
    weighted = np.column_stack([values, np.ones(len(values))]) * triangles.areas[:, None]
    for corner in corners.T:
        np.add.at(nodal, corner, weighted)
    sums.scatter_reverse(la.InsertMode.add)
    sums.scatter_forward()
    means = nodal[:, 0] / nodal[:, 1]
    return np.asarray(means[corners].mean(axis=1))


def best_stiffening(squares: FloatArray, eigenvalues: FloatArray, limit: FloatArray) -> FloatArray:
    """The zeta (...,) that minimises ``sum_a S_a/(a + zeta)/2 + zeta L/2``.

    ``squares`` (..., 3) are the integrals S_a of the squared components of a stress along the
    eigenvectors of A, ``eigenvalues`` (..., 3) the eigenvalues a, and ``limit`` (...,) the
    integrals L of M^2.  zeta is 0 where L is infinite.
    """
    zeta = np.zeros(squares.shape[:-1])
    wanted = 1.0 / np.sqrt(limit)
    for _ in range(_STEPS):
        shifted = eigenvalues + zeta[..., None]
        first = np.sum(squares / shifted**2, axis=-1)
        second = np.sum(squares / shifted**3, axis=-1)
        # Newton's method for the concave function first^-1/2, which is affine for equal a.
        root = np.sqrt(np.maximum(first, 1e-300))
        slope = second / np.maximum(first * root, 1e-300)
        step = np.where(
            (wanted > 0.0) & (second > 0.0), (wanted - 1.0 / root) / np.maximum(slope, 1e-300), 0.0
        )
        new = np.maximum(zeta + step, 0.0)
        if np.all(np.abs(new - zeta) <= 1e-14 * (np.abs(new) + eigenvalues[..., 0])):
            break
        zeta = new
    return zeta
