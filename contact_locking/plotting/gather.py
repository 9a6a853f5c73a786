"""The snapshot of a solution, gathered on rank 0."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import fem
from dolfinx import mesh as dmesh
from scipy.spatial import cKDTree

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.plotting.ground import drawn_tool
from contact_locking.plotting.pieces import Pieces
from contact_locking.plotting.snapshot import ContactMap, Snapshot
from contact_locking.results.contact_points import contact_name
from contact_locking.results.solution import StudySolution


def gather(solution: StudySolution) -> Snapshot | None:
    """The snapshot on rank 0, None elsewhere; collective.

    Each rank sends the nodes and the pieces of cells that it owns.  A global number is therefore a
    place in the arrays that the ranks make up together.  A cell of degree 1 is one piece.  The
    nodes of a cell of degree 2 divide the cell into pieces with straight sides.
    """
    domain, u = solution.domain, solution.displacement
    dim, comm, dofmap = domain.dim, domain.comm, u.function_space.dofmap
    node_map, cell_map = dofmap.index_map, domain.mesh.topology.index_map(dim)
    nodes, cells = node_map.size_local, cell_map.size_local
    pieces = Pieces.of(dim, solution.element.degree)
    facet_cells, facet_pieces, facet_nodes = _boundary(u.function_space, pieces)

    def whole(local: Any) -> Any:
        parts = comm.gather(local)
        return None if parts is None else np.concatenate(parts)

    x = whole(u.function_space.tabulate_dof_coordinates()[:nodes, :dim])
    displacement = whole(u.x.array.reshape(-1, dim)[:nodes])
    nodal = [(whole(one.surface.points), whole(one.smoothed_stress)) for one in solution.contacts]
    piece_nodes = dofmap.list[:cells][:, pieces.nodes].reshape(-1, dim + 1)
    all_pieces = whole(_numbers(node_map, piece_nodes))
    boundary = whole(_numbers(node_map, facet_nodes))
    boundary_piece = whole(_numbers(cell_map, facet_cells) * len(pieces.nodes) + facet_pieces)
    strain = whole(pieces.strain_norm(solution))
    limit = whole(pieces.at_points(solution.locking_limit))
    locked = whole(pieces.at_points(solution.locked))
    points, facets = solution.contact_points, solution.contact_facets
    if points is None or facets is None:
        return None
    vertex = _nearest(points.x, x)
    # At a node of two contacts each has a smoothed stress of its own.
    pairs = zip(points.parts(), nodal, strict=True)
    smoothed = [values[_nearest(part.x, places)] for part, (places, values) in pairs]
    numbers = np.unique(points.contact)
    names = tuple(contact_name(solution.summary, int(number)) for number in numbers)
    return Snapshot(
        x=x,
        displacement=displacement,
        cells=all_pieces,
        boundary=boundary,
        boundary_cell=boundary_piece,
        strain_norm=strain,
        locking_limit=limit,
        locked=locked >= 0.5,
        contact=ContactMap(
            points,
            facets,
            vertex,
            np.concatenate([np.empty(0), *smoothed]),
            names,
            tuple(drawn_tool(solution.contacts[number].outline, x) for number in numbers),
        ),
        title=solution.parameters.title,
        dofs=solution.summary["dofs"],
        locked_fraction=solution.summary["locked_fraction"],
        converged=solution.converged,
    )


def _boundary(space: fem.FunctionSpace, pieces: Pieces) -> tuple[IntArray, IntArray, IntArray]:
    """The pieces of owned exterior facets: cells (m,), pieces of the cell (m,), nodes (m, d).

    Cells and nodes have local numbers.
    """
    topology = space.mesh.topology
    dim = topology.dim
    topology.create_connectivity(dim - 1, dim)
    topology.create_connectivity(dim, dim - 1)
    facets = dmesh.exterior_facet_indices(topology)
    to_cell = topology.connectivity(dim - 1, dim)
    cells = to_cell.array[to_cell.offsets[facets]]
    facets_of = topology.connectivity(dim, dim - 1).array.reshape(-1, dim + 1)
    place = np.argmax(facets_of[cells] == facets[:, None], axis=1)
    layout = space.dofmap.dof_layout
    closure = [set(layout.entity_closure_dofs(dim - 1, i)) for i in range(dim + 1)]
    outer = [pieces.facets_within(nodes) for nodes in closure]
    numbers, nodes = (np.array(found) for found in zip(*outer, strict=True))
    local = space.dofmap.list[cells[:, None, None], nodes[place]]
    return np.repeat(cells, nodes.shape[1]), numbers[place].reshape(-1), local.reshape(-1, dim)


def _nearest(points: FloatArray, places: FloatArray) -> IntArray:
    """For each point (k, d) the number of the nearest place (m, d)."""
    return np.asarray(cKDTree(places).query(points)[1], dtype=np.int64)


def _numbers(index_map: Any, local: Any) -> IntArray:
    """The global numbers of local numbers, in an array of the same shape."""
    flat = np.ascontiguousarray(local, dtype=np.int32).reshape(-1)
    return index_map.local_to_global(flat).reshape(np.shape(local))
