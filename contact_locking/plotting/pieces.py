"""The straight pieces into which the nodes of an element divide each cell, with their values."""

from __future__ import annotations

from dataclasses import dataclass

import basix
import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.fem import compiled
from contact_locking.laws.elasticity import strain
from contact_locking.results.solution import StudySolution

# Nodes of a cell of degree 2: first the corners, then the middles of the edges in the order of
# DOLFINx.  The pieces at the corners come first, in the order of the corners.  The octahedron
# between the corners of a tetrahedron is divided along a line between opposite edges, 4 and 9.
_QUADRATIC = {
    2: ((0, 5, 4), (1, 3, 5), (2, 4, 3), (3, 4, 5)),
    3: (
        *((0, 9, 8, 7), (1, 9, 6, 5), (2, 8, 6, 4), (3, 7, 5, 4)),
        *((4, 9, 5, 6), (4, 9, 6, 8), (4, 9, 8, 7), (4, 9, 7, 5)),
    ),
}


@dataclass(frozen=True)
class Pieces:
    """The pieces (p, d + 1) of a cell, by the numbers of the element's nodes in a cell."""

    nodes: IntArray

    @classmethod
    def of(cls, dim: int, degree: int) -> Pieces:
        """The pieces for displacements of degree 1 or 2 in d dimensions."""
        whole = (tuple(range(dim + 1)),)
        return cls(np.array(whole if degree == 1 else _QUADRATIC[dim], dtype=np.int64))

    def facets_within(self, nodes: set[int]) -> tuple[list[int], list[IntArray]]:
        """The facets of pieces whose nodes are all among ``nodes``: the pieces, and the facets."""
        owners, facets = [], []
        for number, piece in enumerate(self.nodes):
            for left_out in range(self.nodes.shape[1]):
                facet = np.delete(piece, left_out)
                if nodes.issuperset(facet):
                    owners.append(number)
                    facets.append(facet)
        return owners, facets

    def strain_norm(self, solution: StudySolution) -> FloatArray:
        """|eps(u)| (k,) at the midpoints of the pieces of owned cells; collective.

        For an axisymmetric body these are the values of :meth:`at_points`.
        """
        if len(self.nodes) == 1 or solution.domain.axisymmetric:
            return self.at_points(solution.strain_norm)
        mesh, dim = solution.domain.mesh, solution.domain.dim
        space = fem.functionspace(mesh, ("DG", 1, (dim, dim)))
        eps = fem.Function(space)
        expression = strain(solution.displacement)
        eps.interpolate(compiled.interpolation(expression, space))
        at_corners = _in_cells(eps).reshape(-1, dim + 1, dim * dim)
        at_midpoints = np.einsum("pc,kcm->kpm", self._midpoints(space), at_corners)
        return np.asarray(np.linalg.norm(at_midpoints, axis=2).reshape(-1))

    def at_points(self, function: fem.Function) -> FloatArray:
        """The values (k,) of a scalar in the space of strains for the pieces of owned cells.

        A piece at a corner of the cell has the value of the point beside the corner, a piece in the
        middle the mean of all points.
        """
        values = _in_cells(function)[:, :, 0]
        corners = self.nodes.shape[1]
        if len(self.nodes) == 1:
            return np.asarray(values[:, 0])
        middle = np.repeat(values.mean(axis=1)[:, None], len(self.nodes) - corners, axis=1)
        beside = np.broadcast_to(values, (len(values), corners))
        return np.hstack([beside, middle]).reshape(-1)

    def _midpoints(self, space: fem.FunctionSpace) -> FloatArray:
        """The barycentric coordinates (p, d + 1) of the midpoints of the pieces."""
        corners = np.eye(self.nodes.shape[1])
        edges = basix.topology(space.element.basix_element.cell_type)[1]
        nodes = np.vstack([corners, *(corners[edge].mean(axis=0)[None] for edge in edges)])
        return np.asarray(nodes[self.nodes].mean(axis=1))


def _in_cells(function: fem.Function) -> FloatArray:
    """The values (k, points, components) of a function in owned cells."""
    dofmap, mesh = function.function_space.dofmap, function.function_space.mesh
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    return np.asarray(function.x.array.reshape(-1, dofmap.bs)[dofmap.list[:owned]])
