"""Everything a picture shows, gathered on rank 0 as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx import mesh as dmesh
from scipy.spatial import cKDTree

from contact_locking.solution import ContactPoints, Solution

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class ContactMap:
    """Gamma_C: its points, and its facets (m, d) as indices of them.

    ``vertices`` (k,) are the points as vertices of the body, ``smoothed`` (k,) is R sigma_nu.
    """

    points: ContactPoints
    facets: IntArray
    vertices: IntArray
    smoothed: FloatArray


@dataclass(frozen=True)
class Snapshot:
    """The body with v vertices, c cells and b boundary facets, numbered over all ranks.

    ``x`` and ``displacement`` are (v, d), ``cells`` (c, d + 1), ``boundary`` (b, d) and
    ``boundary_cell`` (b,); strain norm, locking limit and ``locked`` are (c,).
    """

    x: FloatArray
    displacement: FloatArray
    cells: IntArray
    boundary: IntArray
    boundary_cell: IntArray
    strain_norm: FloatArray
    locking_limit: FloatArray
    locked: npt.NDArray[np.bool_]
    contact: ContactMap | None
    title: str
    summary: dict[str, Any]

    @property
    def dim(self) -> int:
        return int(self.x.shape[1])

    @property
    def size(self) -> float:
        """The longest edge of the body's bounding box."""
        return float(np.ptp(self.x, axis=0).max())


def gather(solution: Solution) -> Snapshot | None:
    """The snapshot on rank 0, None elsewhere; collective.

    A rank sends the vertices and cells it owns, so that each arrives once; their global numbers
    are those of the concatenation over ranks.
    """
    domain, u = solution.domain, solution.displacement
    mesh, dim, comm = domain.mesh, domain.dim, domain.comm
    dofmap = u.function_space.dofmap
    vertex_map, cell_map = dofmap.index_map, mesh.topology.index_map(dim)
    vertices, cells = vertex_map.size_local, cell_map.size_local
    facets, facet_cells, facet_vertices = _boundary(u.function_space)
    on_contact = np.isin(facets, domain.facets(solution.parameters.contact.on))

    def whole(local: Any) -> Any:
        parts = comm.gather(local)
        return None if parts is None else np.concatenate(parts)

    x = whole(u.function_space.tabulate_dof_coordinates()[:vertices, :dim])
    displacement = whole(u.x.array.reshape(-1, dim)[:vertices])
    smoothed = whole(_at_vertices(solution.smoothed_stress, u.function_space)[:vertices])
    all_cells = whole(_numbers(vertex_map, dofmap.list[:cells]))
    boundary = whole(_numbers(vertex_map, facet_vertices))
    boundary_cell = whole(_numbers(cell_map, facet_cells))
    contact = whole(on_contact)
    strain, limit, locked = (
        whole(function.x.array[function.function_space.dofmap.list[:cells, 0]])
        for function in (solution.strain_norm, solution.locking_limit, solution.locked)
    )
    if comm.rank != 0:
        return None
    return Snapshot(
        x=x,
        displacement=displacement,
        cells=all_cells,
        boundary=boundary,
        boundary_cell=boundary_cell,
        strain_norm=strain,
        locking_limit=limit,
        locked=locked > 0.5,
        contact=_contact_map(solution.contact_points, x, boundary[contact], smoothed),
        title=solution.parameters.title,
        summary=solution.summary,
    )


def _boundary(space: fem.FunctionSpace) -> tuple[IntArray, IntArray, IntArray]:
    """Owned exterior facets, their cells, and their vertices (m, d), in local numbers."""
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
    closure = np.array([layout.entity_closure_dofs(dim - 1, i) for i in range(dim + 1)])
    return facets, cells, space.dofmap.list[cells[:, None], closure[place]]


def _at_vertices(function: fem.Function, space: fem.FunctionSpace) -> FloatArray:
    """A scalar P1 function in the numbering of another P1 space's nodes."""
    dofmap = space.dofmap
    values = np.zeros(dofmap.index_map.size_local + dofmap.index_map.num_ghosts)
    values[dofmap.list] = function.x.array[function.function_space.dofmap.list]
    return values


def _numbers(index_map: Any, local: Any) -> IntArray:
    """Global numbers of local ones, in the same shape."""
    flat = np.ascontiguousarray(local, dtype=np.int32).reshape(-1)
    return index_map.local_to_global(flat).reshape(np.shape(local))


def _contact_map(
    points: ContactPoints | None, x: FloatArray, facets: IntArray, smoothed: FloatArray
) -> ContactMap | None:
    if points is None or len(points.x) == 0 or len(facets) == 0:
        return None
    _, vertices = cKDTree(x).query(points.x)
    point_of = np.full(len(x), -1)
    point_of[vertices] = np.arange(len(vertices))
    return ContactMap(points, point_of[facets], vertices, smoothed[vertices])
