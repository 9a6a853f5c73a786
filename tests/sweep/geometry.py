"""Nodes, cells and named facets of a mesh as NumPy arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from contact_locking import _compat
from contact_locking.arrays import FloatArray
from contact_locking.mesh.domain import Domain

from .boxes import corners_of

IntArray = npt.NDArray[np.integer[Any]]


@dataclass(frozen=True)
class Geometry:
    """Nodes ``x`` (k, d) and cells (c, s) by their corners; ``node_of`` those of the mesh."""

    domain: Domain
    x: FloatArray
    cells: IntArray
    node_of: IntArray

    @classmethod
    def of(cls, domain: Domain, space: Any) -> Geometry:
        """With the numbers that the dofs of a space of displacements give to the nodes."""
        cells = space.dofmap.list
        corners = _compat.cell_nodes(domain.mesh)
        node_of = np.empty(int(corners.max()) + 1, dtype=np.int64)
        node_of[corners] = cells[:, : corners.shape[1]]
        return cls(domain, space.tabulate_dof_coordinates()[:, : domain.dim], cells, node_of)

    def facets(self, names: tuple[str, ...]) -> IntArray:
        """The facets (f, s) of some parts of the boundary."""
        mesh, kind = self.domain.mesh, self.domain.kind
        found = self.domain.facets(names)
        if not len(found):
            return np.empty((0, kind.facet.corners), dtype=np.int64)
        return self.node_of[_compat.entities_to_geometry(mesh, kind.dim - 1, found)]

    def normals(self, facets: IntArray) -> FloatArray:
        """Outward normals (f, d), as long as the facets are large."""
        dim = self.x.shape[1]
        edges = self.x[facets[:, 1:]] - self.x[facets[:, :1]]
        if dim == 2:
            normals = np.stack([edges[:, 0, 1], -edges[:, 0, 0]], axis=1)
        else:
            # Of a quadrilateral, a parallelogram, they are the sides.
            share = 0.5 if self.domain.kind.is_simplex else 1.0
            normals = share * np.cross(edges[:, 0], edges[:, 1])
        opposite = self._opposite(facets)
        inwards = np.einsum("fd,fd->f", normals, opposite - self.x[facets[:, 0]])
        return normals * np.where(inwards > 0.0, -1.0, 1.0)[:, None]

    def _opposite(self, facets: IntArray) -> FloatArray:
        """The middle of the cell of each facet."""
        cell_of: dict[tuple[int, ...], int] = {}
        wanted = [_corners(facet) for facet in facets]
        surface = set(wanted)
        for corners in self.domain.kind.facets:
            for number, side in enumerate(self.cells[:, list(corners)]):
                key = _corners(side)
                if key in surface:
                    cell_of[key] = number
        cells = np.array([cell_of[facet] for facet in wanted], dtype=np.int64)
        return np.asarray(self.x[self.cells[cells]].mean(axis=1))

    def measures(self, facets: IntArray) -> FloatArray:
        """``int phi_i phi_j`` (f, s, s) of the functions of the nodes of facets (f, s)."""
        count, dim = facets.shape[1], self.x.shape[1] - 1
        share: FloatArray = (np.ones((count, count)) + np.eye(count)) / (count * (count + 1))
        if not self.domain.kind.is_simplex:
            # 1/3 for each axis along which two corners are alike, and 1/6 for the others.
            corners = corners_of(dim)
            alike = corners[:, None] == corners[None]
            share = np.where(alike, 1.0 / 3.0, 1.0 / 6.0).prod(axis=2)
        return np.linalg.norm(self.normals(facets), axis=1)[:, None, None] * share


def _corners(facet: Any) -> tuple[int, ...]:
    return tuple(sorted(int(node) for node in facet))
