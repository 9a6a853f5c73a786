"""Nodes, cells and named facets of a mesh as NumPy arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from contact_locking import _compat
from contact_locking.arrays import FloatArray
from contact_locking.mesh.domain import Domain

from .boxes import nodes_of, products

IntArray = npt.NDArray[np.integer[Any]]

# ``int phi_i phi_j`` of a degree on a line of length 1, from end to end.
_LINE = {
    1: np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0,
    2: np.array([[4.0, 2.0, -1.0], [2.0, 16.0, 2.0], [-1.0, 2.0, 4.0]]) / 30.0,
}


@dataclass(frozen=True)
class Geometry:
    """Nodes ``x`` (k, d) and cells (c, s) by their nodes; ``node_of`` those of the mesh.

    Cells of degree 2, which are boxes, have their corners first.
    """

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
        """The facets (f, s) of some parts of the boundary, the corners first."""
        mesh, kind = self.domain.mesh, self.domain.kind
        found = self.domain.facets(names)
        if not len(found):
            return np.empty((0, kind.facet.corners), dtype=np.int64)
        corners = self.node_of[_compat.entities_to_geometry(mesh, kind.dim - 1, found)]
        if self.cells.shape[1] == kind.corners:
            return corners
        cells, place = self._owners(corners)
        nodes, facets = nodes_of(kind.dim, 2), []
        for cell, number in zip(cells, place, strict=True):
            # On a side of the box one coordinate is that of all corners of the side.
            ends = nodes[list(kind.facets[number])]
            axis = int(np.argmin(np.ptp(ends, axis=0)))
            facets.append(self.cells[cell, nodes[:, axis] == ends[0, axis]])
        return np.array(facets)

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
        cells, _ = self._owners(facets[:, : self.domain.kind.facet.corners])
        return np.asarray(self.x[self.cells[cells]].mean(axis=1))

    def _owners(self, facets: IntArray) -> tuple[IntArray, IntArray]:
        """The cell of each facet, given by its corners, and which facet of the cell it is."""
        across: dict[tuple[int, ...], tuple[int, int]] = {}
        wanted = [_corners(facet) for facet in facets]
        surface = set(wanted)
        for place, corners in enumerate(self.domain.kind.facets):
            for number, side in enumerate(self.cells[:, list(corners)]):
                key = _corners(side)
                if key in surface:
                    across[key] = number, place
        found = np.array([across[facet] for facet in wanted], dtype=np.int64).reshape(-1, 2)
        return found[:, 0], found[:, 1]

    def measures(self, facets: IntArray) -> FloatArray:
        """``int phi_i phi_j`` (f, s, s) of the functions of the nodes of facets (f, s)."""
        count, dim = facets.shape[1], self.x.shape[1] - 1
        share: FloatArray = (np.ones((count, count)) + np.eye(count)) / (count * (count + 1))
        if not self.domain.kind.is_simplex:
            degree = 1 if count == 1 << dim else 2
            share = products(nodes_of(dim, degree), _LINE[degree])
        return np.linalg.norm(self.normals(facets), axis=1)[:, None, None] * share


def _corners(facet: Any) -> tuple[int, ...]:
    return tuple(sorted(int(node) for node in facet))
