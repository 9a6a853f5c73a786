"""Forces along the boundary of a body whose strain is limited, as of bars in its facets.

A force T along the facets carries loads beside the stress s, ``s nu = g + T' t`` on Gamma_N, at the
cost ``int M |T|`` (docs/certificate.md).  The forces of bars that meet are in balance, or a support
takes them.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import basix
import numpy as np

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.mesh.rank_sums import summed
from contact_locking.theory.guaranteed.macro_element import FACETS, TENSORS, legendre
from contact_locking.theory.guaranteed.triangles import Triangles

# Directions that differ by less do so by rounding.
_ROUNDING = 1e-10
# Each facet is divided into so many pieces, and zeta is constant in each.
_PIECES = 2


class Bars:
    """Bars in the m facets of the boundary where ``limit`` (n,) is finite, or none; collective.

    The force is a polynomial of degree k + 1 along the direction of the facet that all ranks share.
    Its k + 2 coefficients are the values at both ends, and those of the bubbles ``s (1 - s) P_j``.
    ``held`` (n, 3, 2) marks the components that are prescribed on a facet.

    ``cells`` (m,) and ``sides`` (m,) say which side of which triangle each facet is.  ``tied``
    (m, 2) marks the ends where the force is that of the next bar of a straight part of the
    boundary, ``vertices`` (m, 2) are the local numbers of the ends.  At other ends the force is
    zero, unless a support takes it.  ``constraints`` (m, 3 b, k + 2) are the shares of the forces
    in the balance of the facet and of its ends, for b = 2 (k + 1): first b moments on the facet;
    the first row of each of the next two blocks is the force at a tied end.
    """

    def __init__(
        self, triangles: Triangles, degree: int, held: BoolArray, limit: FloatArray | None = None
    ) -> None:
        limit = np.full(len(triangles.areas), np.inf) if limit is None else limit
        self.degree = degree
        bare = triangles.outside & ~held.all(axis=2) & np.isfinite(limit)[:, None]
        self.cells, self.sides = cells, sides = np.nonzero(bare)
        self._turned = triangles.signs[cells, sides] < 0.0
        ends = self._directed(triangles.ends[cells, sides])
        self.lengths = triangles.lengths[cells, sides]
        self._tangents = (ends[:, 1] - ends[:, 0]) / self.lengths[:, None]
        self._limit = limit[cells]
        self.vertices = self._directed(triangles.vertices[cells[:, None], FACETS[sides]])
        self._meet(triangles, held)
        self._integrate()
        self.constraints = self._constraints(held[cells, sides])

    def along(self, strains: FloatArray) -> FloatArray:
        """``d_s w_t`` (m, 2) at both ends, from strains (n, 3, p, 3) at the points of the parts."""
        # The first points of a part are the ends of its facet.
        at_ends = self._directed(strains[self.cells, self.sides, :2])
        stretched = np.einsum("mi,aij,mj->ma", self._tangents, TENSORS, self._tangents)
        return np.einsum("mea,ma->me", at_ends, stretched)

    def best_stiffening(self, forces: FloatArray) -> FloatArray:
        """The zeta (m, 2) that minimises ``T^2/zeta + zeta M^2`` in each half of the facets."""
        return np.sqrt(_PIECES * self._squares(forces)) / self._limit[:, None]

    def solved(self, zeta: FloatArray, along: FloatArray) -> FloatArray:
        """(m, k + 2, 1 + 3 b) the forces that ``along`` (m, 2) and unit multipliers cause.

        They minimise ``int T^2/2 zeta - T d_s w_t`` with the share of the multipliers of
        ``constraints``.
        """
        matrix = np.einsum("mr,rab->mab", self.lengths[:, None] / zeta, self._masses)
        right = np.concatenate(
            [self._work(along)[:, :, None], np.swapaxes(self.constraints, 1, 2)], axis=2
        )
        bars, shapes = np.nonzero(self._zero)
        matrix[bars, shapes] = matrix[bars, :, shapes] = 0.0
        matrix[bars, shapes, shapes] = 1.0
        right[bars, shapes, 0] = 0.0
        return np.linalg.solve(matrix, right)

    def gap(self, forces: FloatArray, along: FloatArray) -> FloatArray:
        """``int M |T| - T d_s w_t`` (m,), from above.

        For the share by which w exceeds M, M is enlarged, as in the cells.
        """
        stretched = np.einsum("ma,rab,mb->mr", along, self._affine_masses, along)
        most = np.maximum(self._limit[:, None] ** 2 / _PIECES, stretched)
        size = np.sum(np.sqrt(self._squares(forces) * most), axis=1)
        return np.asarray(self.lengths * size - self.work(forces, along))

    def work(self, forces: FloatArray, along: FloatArray) -> FloatArray:
        """``int T d_s w_t`` (m,) over the facets."""
        return np.einsum("ma,ma->m", forces, self._work(along))

    def _directed(self, pairs: Any) -> Any:
        """Values (m, 2, ...) at the ends in the order that all ranks share."""
        found = pairs.copy()
        found[self._turned] = pairs[self._turned][:, ::-1]
        return found

    def _meet(self, triangles: Triangles, held: BoolArray) -> None:
        """Find the ends that are tied, those without a force, and the signs of the tied ones."""
        marks = np.repeat(held[:, :, None], 2, axis=2).astype(float)
        at_vertices = partial(summed, triangles.vertex_map)
        holds = at_vertices(triangles.vertices[:, FACETS], marks)[self.vertices] > 0.5
        # The double angle belongs to a direction without a sign.
        t = self._tangents
        double = np.column_stack([t[:, 0] ** 2 - t[:, 1] ** 2, 2.0 * t[:, 0] * t[:, 1]])
        mean = at_vertices(self.vertices, np.repeat(double[:, None], 2, axis=1))[self.vertices]
        angle = 0.5 * np.arctan2(mean[..., 1], mean[..., 0])
        common = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        apart = np.abs(t[:, None, 0] * common[..., 1] - t[:, None, 1] * common[..., 0])
        straight = at_vertices(self.vertices, apart[..., None])[self.vertices, 0] <= _ROUNDING
        taken = np.all(holds | (np.abs(t)[:, None] <= _ROUNDING), axis=2)
        self.tied: BoolArray = straight & ~taken
        self._zero = np.zeros((len(t), self.degree + 2), dtype=bool)
        self._zero[:, :2] = ~straight & ~taken
        # A bar pulls its first end forwards and its last end backwards.
        pulls = np.sign(np.einsum("mi,mei->me", t, common)) * [-1.0, 1.0]
        self._signs = np.where(self.tied, pulls, 0.0)

    def _constraints(self, held: BoolArray) -> FloatArray:
        block = 2 * (self.degree + 1)
        found = np.zeros((len(held), 3, block, self.degree + 2))
        rises = -self._tangents[:, None, :, None] * self._rises[:, None]
        found[:, 0] = np.where(held[:, None, :, None], 0.0, rises).reshape(found[:, 0].shape)
        found[:, [1, 2], 0, [0, 1]] = self._signs
        rows = found.reshape(len(held), 3 * block, self.degree + 2)
        return np.where(self._zero[:, None], 0.0, rows)

    def _integrate(self) -> None:
        """Integrals over a facet of length 1."""
        k = self.degree
        points, weights = basix.make_quadrature(basix.CellType.interval, 2 * k + 2)
        halves = (np.arange(_PIECES)[:, None] + points[:, 0]) / _PIECES
        shapes = _shapes(k, halves.reshape(-1)).reshape(_PIECES, -1, k + 2)
        affine = _shapes(0, halves.reshape(-1)).reshape(_PIECES, -1, 2)
        shares = weights / _PIECES
        self._masses = np.einsum("q,rqa,rqb->rab", shares, shapes, shapes)
        self._affine_masses = np.einsum("q,rqa,rqb->rab", shares, affine, affine)
        self._mixed = np.einsum("q,rqa,rqe->ae", shares, shapes, affine)
        # By parts, int P_j T' = [P_j T] - int P_j' T.
        slopes = np.polynomial.legendre.legder(np.eye(k + 1) * np.sqrt(2 * np.arange(k + 1) + 1.0))
        rates = 2.0 * np.polynomial.legendre.legval(2.0 * halves - 1.0, slopes)
        self._rises = -np.einsum("q,jrq,rqa->ja", shares, rates, shapes)
        self._rises[:, :2] += legendre(k, np.array([0.0, 1.0])).T * [-1.0, 1.0]

    def _work(self, along: FloatArray) -> FloatArray:
        """``int f_a d_s w_t`` (m, k + 2), for the shapes f_a of the force."""
        return np.asarray(self.lengths[:, None] * (along @ self._mixed.T))

    def _squares(self, forces: FloatArray) -> FloatArray:
        """``int T^2`` over each piece (m, r) of a facet of length 1."""
        return np.einsum("ma,rab,mb->mr", forces, self._masses, forces)


def _shapes(degree: int, s: FloatArray) -> FloatArray:
    """The shapes (q, k + 2) of forces of degree k + 1 at points s (q,)."""
    ends = np.column_stack([1.0 - s, s])
    if degree == 0:
        return ends
    return np.column_stack([ends, (s * (1.0 - s))[:, None] * legendre(degree - 1, s)])
