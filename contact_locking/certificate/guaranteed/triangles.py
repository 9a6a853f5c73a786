"""The triangles of a rank as arrays: affine maps, facets, and the directions of facets."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from dolfinx import mesh as dmesh

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IndexArray, IntArray, flattened
from contact_locking.certificate.guaranteed.macro_element import FACETS
from contact_locking.laws.elasticity import MANDEL_PAIRS, mandel_factor
from contact_locking.mesh.domain import Domain


class Triangles:
    """The n owned cells of a mesh of triangles; the constructor is collective.

    ``corners`` (n, 3, 2) are the corners, ``maps`` (n, 2, 2) the matrices F of the affine maps from
    the reference triangle, and ``areas`` (n,).  ``facets`` (n, 3) are the local numbers of the
    facets, each opposite to the corner of its column.  ``signs`` (n, 3) is 1 where the facet has
    the direction that all ranks give the facet, and -1 otherwise.  ``outside`` (n, 3) marks the
    facets on the boundary.
    """

    def __init__(self, domain: Domain) -> None:
        mesh, topology = domain.mesh, domain.mesh.topology
        self.domain = domain
        count = topology.index_map(2).size_local
        self.corners = mesh.geometry.x[_compat.cell_corners(mesh)[:count], :2]
        edges = self.corners[:, 1:] - self.corners[:, :1]
        self.maps = np.swapaxes(edges, 1, 2)
        self.determinants = np.abs(np.linalg.det(self.maps))
        self.areas = 0.5 * self.determinants
        topology.create_connectivity(2, 1)
        topology.create_connectivity(1, 2)
        self.facets: IndexArray = topology.connectivity(2, 1).array.reshape(-1, 3)[:count]
        vertices = topology.connectivity(2, 0).array.reshape(-1, 3)[:count]
        numbers = topology.index_map(0).local_to_global(vertices.reshape(-1)).reshape(-1, 3)
        ends = numbers[:, FACETS]
        self.signs = np.where(ends[:, :, 0] < ends[:, :, 1], 1.0, -1.0)
        self.outside = self._marked(dmesh.exterior_facet_indices(topology))

    @property
    def facet_map(self) -> Any:
        """DOLFINx's index map of the facets."""
        return self.domain.mesh.topology.index_map(1)

    @cached_property
    def transforms(self) -> FloatArray:
        """The matrices (n, 3, 3) of ``r -> F r F^T`` for Mandel vectors."""
        pairs, maps = MANDEL_PAIRS[2], self.maps
        found = np.empty((len(maps), 3, 3))
        for a, (i, j) in enumerate(pairs):
            for b, (k, m) in enumerate(pairs):
                both = maps[:, i, k] * maps[:, j, m] + maps[:, i, m] * maps[:, j, k]
                found[:, a, b] = 0.5 * both * mandel_factor(i, j) * mandel_factor(k, m)
        return found

    @cached_property
    def ends(self) -> FloatArray:
        """The end points (n, 3, 2, 2) of the facets, in the order of the cell."""
        return np.asarray(self.corners[:, FACETS])

    @cached_property
    def lengths(self) -> FloatArray:
        """The lengths (n, 3) of the facets."""
        return np.linalg.norm(self.ends[:, :, 1] - self.ends[:, :, 0], axis=2)

    @cached_property
    def normals(self) -> FloatArray:
        """The outward unit normals (n, 3, 2) of the facets."""
        edges = self.ends[:, :, 1] - self.ends[:, :, 0]
        across = np.stack([edges[:, :, 1], -edges[:, :, 0]], axis=2) / self.lengths[:, :, None]
        # Each facet is opposite to the corner of its column.
        outward = np.einsum("nsi,nsi->ns", across, self.ends[:, :, 0] - self.corners)
        return np.asarray(across * np.sign(outward)[:, :, None])

    @cached_property
    def diameters(self) -> FloatArray:
        """The longest edge (n,)."""
        return np.asarray(self.lengths.max(axis=1))

    def on(self, facets: IndexArray) -> BoolArray:
        """(n, 3) whether each facet on the boundary is one of the given local facets."""
        return self._marked(facets) & self.outside

    def sides_on(self, facets: IndexArray) -> tuple[IntArray, IntArray]:
        """The cells (m,) and the columns (m,) of the facets on the boundary among the given."""
        cells, sides = np.nonzero(self.on(facets))
        return cells.astype(np.int64), sides.astype(np.int64)

    def at(self, points: FloatArray, cells: IntArray | slice = slice(None)) -> FloatArray:
        """The images (m, ..., 2) of points (..., 2) of the reference triangle in m cells."""
        images = points.reshape(-1, 2) @ np.swapaxes(self.maps[cells], 1, 2)
        images += self.corners[cells, :1]
        return images.reshape(len(images), *points.shape)

    def moved(self, reference: FloatArray) -> FloatArray:
        """``F r F^T`` for reference stresses r as Mandel vectors; both are (n, 3, m, 3)."""
        flat = flattened(reference, kept=1)
        return (flat @ np.swapaxes(self.transforms, 1, 2)).reshape(reference.shape)

    def _marked(self, facets: IndexArray) -> BoolArray:
        marks = np.zeros(self.facet_map.size_local + self.facet_map.num_ghosts, dtype=np.bool_)
        marks[facets] = True
        return np.asarray(marks[self.facets])
