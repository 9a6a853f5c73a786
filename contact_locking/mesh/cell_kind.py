"""The kinds of cells: simplices, and boxes, which are quadrilaterals and hexahedra.

Corners are numbered as in DOLFINx: those of a box as the numbers of its corners in binary digits,
the first digit the coordinate along the first axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from contact_locking.arrays import FloatArray, IndexArray, IntArray


@dataclass(frozen=True)
class CellKind:
    """A kind of cells or facets with straight edges.

    ``name`` is the name of the kind in DOLFINx, and ``plural`` that of several cells in words.
    ``gmsh`` is its number in Gmsh, and ``gmsh_order`` (c,) gives for each corner its place there.
    ``facets`` (f, n) are the corners of each facet.  ``simplices`` (p, dim + 1) divide the cell,
    and ``beside`` (s, dim + 1) are the simplices of each corner with its neighbours: their volumes
    are the Jacobian at the corners, and have one sign in a convex cell.
    """

    name: str
    plural: str
    dim: int
    gmsh: int
    gmsh_order: tuple[int, ...]
    facets: tuple[tuple[int, ...], ...]
    simplices: tuple[tuple[int, ...], ...]
    beside: tuple[tuple[int, ...], ...]

    @property
    def corners(self) -> int:
        return len(self.gmsh_order)

    @property
    def is_simplex(self) -> bool:
        """Whether the cell is a simplex, in which affine fields have constant gradients."""
        return self.corners == self.dim + 1

    @property
    def measure(self) -> float:
        """The measure of the reference cell."""
        return 1.0 / math.factorial(self.dim) if self.is_simplex else 1.0

    @property
    def facet(self) -> CellKind:
        return KINDS[self.dim - 1, len(self.facets[0])]

    @cached_property
    def opposite(self) -> IntArray:
        """(f,) a corner that is not on each facet; corner i for facet i of a simplex."""
        every = range(self.corners)
        return np.array([min(set(every) - set(facet)) for facet in self.facets])

    def facets_of(self, cells: IntArray) -> IntArray:
        """The facets (f k, n) of cells (k, c), facet after facet, as corners."""
        return np.concatenate([cells[:, list(facet)] for facet in self.facets])

    def split(self, cells: IntArray | IndexArray) -> IntArray:
        """The simplices (k p, dim + 1) of cells (k, c), cell after cell."""
        pieces = cells[:, np.array(self.simplices)].reshape(-1, self.dim + 1)
        return np.asarray(pieces, dtype=np.int64)

    def basis(self, points: FloatArray) -> FloatArray:
        """The values (q, c) of the functions of degree 1 of the corners at points (q, dim)."""
        if self.is_simplex:
            return np.column_stack([1.0 - points.sum(axis=1), points])
        found = np.ones((len(points), self.corners))
        for axis in range(self.dim):
            far = (np.arange(self.corners) >> axis & 1).astype(bool)
            found *= np.where(far, points[:, axis : axis + 1], 1.0 - points[:, axis : axis + 1])
        return found

    def room(self, points: FloatArray) -> FloatArray:
        """(q,) the least distance of points (q, dim) to the sides of the reference cell.

        It is negative outside.
        """
        ends = 1.0 - (points.sum(axis=1, keepdims=True) if self.is_simplex else points)
        return np.asarray(np.minimum(points.min(axis=1), ends.min(axis=1)))

    @property
    def places(self) -> FloatArray:
        """The corners (c, dim) of the reference cell."""
        if self.is_simplex:
            return np.vstack([np.zeros(self.dim), np.eye(self.dim)])
        return np.array([[i >> axis & 1 for axis in range(self.dim)] for i in range(self.corners)])


INTERVAL = CellKind("interval", "lines", 1, 1, (0, 1), ((0,), (1,)), ((0, 1),), ((0, 1),))
TRIANGLE = CellKind(
    *("triangle", "triangles", 2, 2, (0, 1, 2)),
    facets=((1, 2), (0, 2), (0, 1)),
    simplices=((0, 1, 2),),
    beside=((0, 1, 2),),
)
QUADRILATERAL = CellKind(
    *("quadrilateral", "quadrilaterals", 2, 3, (0, 1, 3, 2)),
    facets=((0, 1), (0, 2), (1, 3), (2, 3)),
    simplices=((0, 1, 2), (3, 2, 1)),
    beside=((0, 1, 2), (1, 3, 0), (2, 0, 3), (3, 2, 1)),
)
TETRAHEDRON = CellKind(
    *("tetrahedron", "tetrahedra", 3, 4, (0, 1, 2, 3)),
    facets=((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)),
    simplices=((0, 1, 2, 3),),
    beside=((0, 1, 2, 3),),
)
HEXAHEDRON = CellKind(
    *("hexahedron", "hexahedra", 3, 5, (0, 1, 3, 2, 4, 5, 7, 6)),
    facets=((0, 1, 2, 3), (0, 1, 4, 5), (0, 2, 4, 6), (1, 3, 5, 7), (2, 3, 6, 7), (4, 5, 6, 7)),
    # The six simplices along the diagonal from corner 0 to corner 7.
    simplices=(
        *((0, 1, 3, 7), (0, 5, 1, 7), (0, 3, 2, 7)),
        *((0, 2, 6, 7), (0, 4, 5, 7), (0, 6, 4, 7)),
    ),
    beside=(
        *((0, 1, 2, 4), (1, 3, 0, 5), (2, 0, 3, 6), (3, 2, 1, 7)),
        *((4, 6, 5, 0), (5, 4, 7, 1), (6, 7, 4, 2), (7, 5, 6, 3)),
    ),
)

#: The kinds by dimension and number of corners.
KINDS = {
    (kind.dim, kind.corners): kind
    for kind in (INTERVAL, TRIANGLE, QUADRILATERAL, TETRAHEDRON, HEXAHEDRON)
}
#: The kinds of cells of bodies by their names in DOLFINx.
NAMED = {kind.name: kind for kind in KINDS.values() if kind.dim > 1}


def facet_normals(corners: FloatArray) -> FloatArray:
    """Normals (m, d) of facets (m, c, d), whose lengths are the measures of the facets.

    They point to the side that the order of the corners gives.  That of a quadrilateral is the mean
    over the facet, which is the measure of its projection to the mean plane.
    """
    if corners.shape[2] == 2:
        edge = corners[:, 1] - corners[:, 0]
        return np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    one, other = corners[:, -1] - corners[:, 0], corners[:, 2] - corners[:, 1]
    return np.asarray(0.5 * np.cross(one, other), dtype=float)


def unit_normals(corners: FloatArray) -> FloatArray:
    """The unit normals (m, d) of facets (m, c, d), as :func:`facet_normals`."""
    normals = facet_normals(corners)
    return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])
