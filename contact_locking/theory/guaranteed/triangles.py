"""The triangles of a rank as arrays: affine maps, facets, and the directions of facets."""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from dolfinx import mesh as dmesh

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IndexArray, IntArray, flattened
from contact_locking.mesh.domain import Domain
from contact_locking.theory.guaranteed.macro_element import FACETS, TENSORS


class Triangles:
    """The n owned cells of a mesh of triangles; the constructor is collective.

    ``corners`` (n, 3, 2) are the corners, ``vertices`` (n, 3) their local numbers, ``maps`` (n, 2,
    2) the matrices F of the affine maps from the reference triangle, ``transforms`` (n, 3, 3) those
    of ``r -> F r F^T`` for Mandel vectors, and ``areas`` (n,).

    ``facets`` (n, 3) are the local numbers of the facets, each opposite to the corner of its
    column, with end points ``ends`` (n, 3, 2, 2), ``lengths`` (n, 3) and outward unit ``normals``
    (n, 3, 2).  ``signs`` (n, 3) is 1 where the facet has the direction that all ranks give the
    facet, and -1 otherwise.  ``outside`` (n, 3) marks the facets on the boundary.
    """

    def __init__(self, domain: Domain) -> None:
        mesh, topology = domain.mesh, domain.mesh.topology
        self.domain = domain
        count = topology.index_map(2).size_local
        self.corners = mesh.geometry.x[_compat.cell_corners(mesh)[:count], :2]
        self.maps = np.swapaxes(self.corners[:, 1:] - self.corners[:, :1], 1, 2)
        self.areas = 0.5 * np.abs(np.linalg.det(self.maps))
        turned = self.maps[:, None] @ TENSORS @ np.swapaxes(self.maps, 1, 2)[:, None]
        self.transforms = np.einsum("nbij,aij->nab", turned, TENSORS)
        topology.create_connectivity(2, 1)
        topology.create_connectivity(1, 2)
        #: DOLFINx's index maps of the facets and of the vertices.
        self.facet_map, self.vertex_map = topology.index_map(1), topology.index_map(0)
        self.facets: IndexArray = topology.connectivity(2, 1).array.reshape(-1, 3)[:count]
        self.vertices: IndexArray = topology.connectivity(2, 0).array.reshape(-1, 3)[:count]
        at_ends = self.vertices[:, FACETS]
        numbers = self.vertex_map.local_to_global(at_ends.reshape(-1)).reshape(at_ends.shape)
        self.signs = np.where(numbers[:, :, 0] < numbers[:, :, 1], 1.0, -1.0)
        self.outside = self._marked(dmesh.exterior_facet_indices(topology))
        self.ends = self.corners[:, FACETS]
        edges = self.ends[:, :, 1] - self.ends[:, :, 0]
        self.lengths = np.linalg.norm(edges, axis=2)
        across = np.stack([edges[:, :, 1], -edges[:, :, 0]], axis=2) / self.lengths[:, :, None]
        outward = np.einsum("nsi,nsi->ns", across, self.ends[:, :, 0] - self.corners)
        self.normals = across * np.sign(outward)[:, :, None]

    def sides_on(self, facets: IndexArray) -> tuple[IntArray, IntArray]:
        """The cells (m,) and the columns (m,) of the facets on the boundary among the given."""
        cells, sides = np.nonzero(self._marked(facets) & self.outside)
        return cells.astype(np.int64), sides.astype(np.int64)

    def at(self, points: FloatArray) -> FloatArray:
        """The images (n, ..., 2) of points (..., 2) of the reference triangle."""
        images = points.reshape(-1, 2) @ np.swapaxes(self.maps, 1, 2) + self.corners[:, :1]
        return np.asarray(images.reshape(len(images), *points.shape))

    def moved(self, reference: FloatArray) -> FloatArray:
        """``F r F^T`` for reference stresses r as Mandel vectors; both are (n, 3, m, 3)."""
        flat = flattened(reference, kept=1)
        return (flat @ np.swapaxes(self.transforms, 1, 2)).reshape(reference.shape)

    def at_nodes(self, u: fem.Function) -> FloatArray:
        """The values (n, m, 2) of a displacement at the m nodes of each triangle."""
        return np.asarray(u.x.array.reshape(-1, 2)[u.function_space.dofmap.list[: len(self.areas)]])

    def _marked(self, facets: IndexArray) -> BoolArray:
        marks = np.zeros(self.facet_map.size_local + self.facet_map.num_ghosts, dtype=np.bool_)
        marks[facets] = True
        return np.asarray(marks[self.facets])
