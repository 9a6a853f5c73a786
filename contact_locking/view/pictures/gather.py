"""The snapshot of a solution, gathered on rank 0."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem
from dolfinx import mesh as dmesh
from scipy.spatial import cKDTree

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.fem.spaces import facet_places
from contact_locking.mesh.data import CellKind
from contact_locking.mesh.domain import Domain
from contact_locking.results.solution import Solution
from contact_locking.shapes.faceted import FacetedFoundation
from contact_locking.shapes.shape import Distance, MovedDistance, Shape
from contact_locking.view.pictures.style import ContactMap, Snapshot, drawn_tool

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
    of_simplex: bool = True

    @classmethod
    def of(cls, kind: CellKind, degree: int) -> Pieces:
        """The pieces for displacements of degree 1 or 2 in cells of a kind."""
        if degree == 1:
            return cls(np.array(kind.simplices, dtype=np.int64), kind.is_simplex)
        return cls(np.array(_QUADRATIC[kind.dim], dtype=np.int64))

    def facets_within(self, nodes: set[int]) -> list[tuple[int, IntArray]]:
        """The facets of pieces whose nodes are all among ``nodes``, each after its piece."""
        return [
            (number, facet)
            for number, piece in enumerate(self.nodes)
            for facet in (np.delete(piece, corner) for corner in range(self.nodes.shape[1]))
            if nodes.issuperset(facet)
        ]

    def at_points(self, function: fem.Function) -> FloatArray:
        """The values (k,) of a scalar in the space of strains for the pieces of owned cells.

        A piece at a corner of the cell has the value of the point beside the corner, a piece in the
        middle the mean of all points.  A piece of a box has the mean of the points beside its
        corners.
        """
        topology = function.function_space.mesh.topology
        owned = topology.index_map(topology.dim).size_local
        values = function.x.array[function.function_space.dofmap.list[:owned]]
        if not self.of_simplex:
            return np.asarray(values[:, self.nodes].mean(axis=2).reshape(-1))
        corners = self.nodes.shape[1]
        if len(self.nodes) == 1:
            return np.asarray(values[:, 0])
        middle = np.repeat(values.mean(axis=1)[:, None], len(self.nodes) - corners, axis=1)
        beside = np.broadcast_to(values, (len(values), corners))
        return np.hstack([beside, middle]).reshape(-1)


def gather(solution: Solution) -> Snapshot | None:
    """The snapshot on rank 0, None elsewhere; collective.

    Each rank sends the nodes and the pieces of cells that it owns.  A global number is therefore a
    place in the arrays that the ranks make up together.  A cell of degree 1 is one piece.  The
    nodes of a cell of degree 2 divide the cell into pieces with straight sides.
    """
    domain, u = solution.domain, solution.displacement
    dim, comm, dofmap = domain.dim, domain.comm, u.function_space.dofmap
    node_map, cell_map = dofmap.index_map, domain.mesh.topology.index_map(dim)
    nodes, cells = node_map.size_local, cell_map.size_local
    pieces = Pieces.of(domain.kind, solution.element.degree)
    facet_cells, facet_pieces, facet_nodes = _boundary(domain, u.function_space, pieces)

    def whole(local: Any) -> Any:
        parts = comm.gather(local)
        return None if parts is None else np.concatenate(parts)

    piece_nodes = dofmap.list[:cells][:, pieces.nodes].reshape(-1, dim + 1)
    fields = {
        "x": whole(u.function_space.tabulate_dof_coordinates()[:nodes, :dim]),
        "displacement": whole(u.x.array.reshape(-1, dim)[:nodes]),
        "cells": whole(_numbers(node_map, piece_nodes)),
        "boundary": whole(_numbers(node_map, facet_nodes)),
        "boundary_cell": whole(_numbers(cell_map, facet_cells) * len(pieces.nodes) + facet_pieces),
        "strain_norm": whole(pieces.at_points(solution.strain_norm)),
        "locking_limit": whole(pieces.at_points(solution.locking_limit)),
        "locked": whole(pieces.at_points(solution.locked) >= 0.5),
    }
    nodal = [(whole(c.surface.points), whole(c.smoothed_stress)) for c in solution.contacts]
    points, facets, x = solution.contact_points, solution.contact_facets, fields["x"]
    if points is None or facets is None:
        return None
    # At a node of two contacts each has a smoothed stress of its own.
    pairs = zip(points.parts(), nodal, strict=True)
    smoothed = [values[_nearest(points.x, places)] for points, (places, values) in pairs]
    listed = solution.summary["contacts"]
    numbers = np.unique(points.contact)
    names = tuple(listed[number]["name"] for number in numbers)
    touching = [solution.contacts[number] for number in numbers]
    return Snapshot(
        **fields,
        contact=ContactMap(
            points,
            facets,
            _nearest(points.x, x),
            np.concatenate([np.empty(0), *smoothed]),
            names,
            tuple(drawn_tool(outline(c.tool, c.travel, domain), x) for c in touching),
            tuple(c.surface.is_paired for c in touching),
        ),
        title=solution.summary.get("title", ""),
        dofs=solution.summary["dofs"],
        locked_fraction=solution.summary["locked_fraction"],
        converged=solution.converged,
    )


def _boundary(
    domain: Domain, space: fem.FunctionSpace, pieces: Pieces
) -> tuple[IntArray, IntArray, IntArray]:
    """The pieces of owned exterior facets: cells (m,), pieces of the cell (m,), nodes (m, d).

    Cells and nodes have local numbers.
    """
    topology, dim = domain.mesh.topology, domain.dim
    topology.create_connectivity(dim - 1, dim)
    facets = dmesh.exterior_facet_indices(topology)
    cells = domain.owners(facets)
    place, layout = facet_places(domain, facets, cells), space.dofmap.dof_layout
    closures = (layout.entity_closure_dofs(dim - 1, i) for i in range(len(domain.kind.facets)))
    outer = [pieces.facets_within(set(closure)) for closure in closures]
    owners = np.array([[owner for owner, _ in facets] for facets in outer])
    nodes = np.array([[facet for _, facet in facets] for facets in outer])
    local = space.dofmap.list[cells[:, None, None], nodes[place]]
    return np.repeat(cells, nodes.shape[1]), owners[place].reshape(-1), local.reshape(-1, dim)


def _nearest(points: FloatArray, places: FloatArray) -> IntArray:
    return np.asarray(cKDTree(places).query(points)[1], dtype=np.int64)


def _numbers(index_map: Any, local: Any) -> IntArray:
    """The global numbers of local numbers, in an array of the same shape."""
    flat = np.ascontiguousarray(local, dtype=np.int32).reshape(-1)
    return index_map.local_to_global(flat).reshape(np.shape(local))


# The box reaches beyond the body by this share of the longest edge of the body's own box.
_BESIDE = 0.25
# The points of the grid along each axis, by the dimension.
_GRID = {2: 201, 3: 61}


def outline(tool: Distance | None, travel: FloatArray, domain: Domain) -> FloatArray:
    """The facets (t, d, d) of ``phi = 0`` around the body, in 2D with the foundation on their left.

    A force has moved the foundation by ``travel`` (d,).  A half space in 3D is drawn as ground.
    """
    dim, nothing = domain.dim, np.empty((0, domain.dim, domain.dim))
    body = tool.body if isinstance(tool, MovedDistance) else tool
    if tool is None or (dim == 3 and isinstance(body, Shape) and body.is_plane):
        return nothing
    if isinstance(body, FacetedFoundation):
        corners: FloatArray = body.facets.reshape(-1, dim).T
        corners = tool.motion.moved(corners) if isinstance(tool, MovedDistance) else corners
        return corners.T.reshape(body.facets.shape) + travel
    margin = _BESIDE * float(np.ptp(domain.bounding_box, axis=0).max())
    low, high = domain.bounding_box + np.array([[-margin], [margin]])
    if domain.axisymmetric:
        low[0] = max(low[0], 0.0)
    axes = [np.linspace(a, b, _GRID[dim]) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"))
    try:
        with np.errstate(all="ignore"):
            distance = tool.gap(points.reshape(dim, -1) - travel[:, None])
    except InputError:
        # An expression needs values on Gamma_C only.
        return nothing
    values = np.ma.masked_invalid(distance.reshape(points.shape[1:]))
    if dim == 2:
        import contourpy

        # The lines of contourpy have the larger values on their left.
        lines = contourpy.contour_generator(axes[0], axes[1], values.T).lines(0.0)
        pieces = [np.stack([line[:0:-1], line[-2::-1]], axis=1) for line in map(np.asarray, lines)]
        segments = np.concatenate([nothing, *pieces])
        return np.asarray(segments[np.any(segments[:, 0] != segments[:, 1], axis=1)])
    import pyvista

    if np.ma.is_masked(values) or not values.min() < 0.0 < values.max():
        return nothing
    surface = pyvista.RectilinearGrid(*axes).contour([0.0], np.asarray(values).ravel(order="F"))
    return np.asarray(surface.points[surface.triangulate().faces.reshape(-1, 4)[:, 1:]])
