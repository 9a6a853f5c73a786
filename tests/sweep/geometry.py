"""Nodes, cells and named facets of a mesh as NumPy arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from contact_locking import _compat
from contact_locking.arrays import FloatArray
from contact_locking.mesh.cell_kind import KINDS
from contact_locking.mesh.domain import Domain

IntArray = npt.NDArray[np.integer[Any]]


@dataclass(frozen=True)
class Geometry:
    """Nodes ``x`` (k, d) and cells (c, s) by their nodes; ``node_of`` those of the mesh."""

    domain: Domain
    x: FloatArray
    cells: IntArray
    node_of: IntArray

    @classmethod
    def of(cls, domain: Domain, space: Any) -> Geometry:
        """With the numbers that the dofs of a P1 space give to the nodes."""
        cells = space.dofmap.list
        corners = _compat.cell_nodes(domain.mesh)
        node_of = np.empty(int(corners.max()) + 1, dtype=np.int64)
        node_of[corners] = cells
        return cls(domain, space.tabulate_dof_coordinates()[:, : domain.dim], cells, node_of)

    def facets(self, names: tuple[str, ...]) -> IntArray:
        """The facets (f, s) of some parts of the boundary."""
        mesh, dim = self.domain.mesh, self.domain.dim
        found = self.domain.facets(names)
        if not len(found):
            return np.empty((0, self.domain.kind.facet.corners), dtype=np.int64)
        return self.node_of[_compat.entities_to_geometry(mesh, dim - 1, found)]

    def normals(self, facets: IntArray) -> FloatArray:
        """Outward normals (f, d), as long as the facets are large."""
        dim = self.x.shape[1]
        edges = self.x[facets[:, 1:]] - self.x[facets[:, :1]]
        if dim == 2:
            normals = np.stack([edges[:, 0, 1], -edges[:, 0, 0]], axis=1)
        else:
            # Of a quadrilateral, a parallelogram, they are the sides.
            share = 0.5 if facets.shape[1] == 3 else 1.0
            normals = share * np.cross(edges[:, 0], edges[:, 1])
        opposite = self._opposite(facets)
        inwards = np.einsum("fd,fd->f", normals, opposite - self.x[facets[:, 0]])
        return normals * np.where(inwards > 0.0, -1.0, 1.0)[:, None]

    def _opposite(self, facets: IntArray) -> FloatArray:
        """The middle of the cell of each facet."""
        across: dict[tuple[int, ...], int] = {}
        wanted = [_corners(facet) for facet in facets]
        surface = set(wanted)
        kind = KINDS[self.x.shape[1], self.cells.shape[1]]
        for corners in kind.facets:
            for number, side in enumerate(self.cells[:, list(corners)]):
                key = _corners(side)
                if key in surface:
                    across[key] = number
        owners = [across[facet] for facet in wanted]
        return np.asarray(self.x[self.cells[owners]].mean(axis=1))

    def measures(self, facets: IntArray) -> FloatArray:
        """``int phi_i phi_j`` (f, s, s) of the functions of the corners of facets (f, s)."""
        count = facets.shape[1]
        share: FloatArray = (np.ones((count, count)) + np.eye(count)) / (count * (count + 1))
        if count == 4:
            line = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0
            share = np.asarray(np.kron(line, line), dtype=float)
        return np.linalg.norm(self.normals(facets), axis=1)[:, None, None] * share


def _corners(facet: Any) -> tuple[int, ...]:
    return tuple(sorted(int(node) for node in facet))
