"""The cells to refine, and the finer mesh: regions, boundary parts and curved sides stay.

DOLFINx does not carry mesh tags to the refinement of a mesh with ghost cells
(https://github.com/FEniCS/dolfinx/issues/3443).  Therefore rank 0 refines the whole mesh, which has
no ghosts there, and the result is distributed like any other mesh: the cells are spread evenly
again, and the mesh does not depend on the number of ranks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from dolfinx import mesh as dmesh
from mpi4py import MPI

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.contact.coulomb import default_radius
from contact_locking.errors import NotRefined
from contact_locking.mesh.cell_kind import longest_edges, signed_measures
from contact_locking.mesh.data import MeshData
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.sources import WholeMesh, elements, gather_mesh, spread
from contact_locking.meshes.geometry import Curved, rounded
from contact_locking.parallel import on_root
from contact_locking.results.solution import Solution

# Contributions that differ by this share count as equal: where a problem is symmetric, its mesh
# stays symmetric, and rounding, which depends on the number of ranks, does not decide.
_TIE = 1e-6
# A point of a cell has barycentric coordinates above this.
_INSIDE = -1e-6
# A node that moves onto a curved side may take at most this share of the volume of a cell.
_LARGEST_LOSS = 0.9
# Cells that are smaller than this share of the body are near the rounding of the coordinates.
_SMALLEST_SHARE = 1e-9


def marked_cells(squares: FloatArray, share: float) -> BoolArray:
    """The fewest cells K with ``sum eta_K^2 >= share * sum of all eta_K^2``, as a mask (k,).

    ``squares`` (k,) are the contributions ``eta_K^2 >= 0``, and ``share`` is in (0, 1].  Cells
    whose contributions equal the smallest that is taken are taken as well.  Without an error no
    cell is marked (Doerfler, doi:10.1137/0733054).
    """
    order = np.argsort(-squares, kind="stable")
    sums = np.cumsum(squares[order])
    if not len(sums) or sums[-1] <= 0.0:
        return np.zeros(len(squares), dtype=bool)
    # The last of the sums may be less than the share of itself by rounding.
    last = min(int(np.searchsorted(sums, share * sums[-1])), len(sums) - 1)
    return np.asarray((squares >= (1.0 - _TIE) * squares[order[last]]) & (squares > 0.0))


def entered_places(solution: Solution) -> list[tuple[float, ...]]:
    """Where foundations enter between the nodes of Gamma_C by a notable depth; collective.

    They are the same on all ranks.
    """
    return [place for fields in solution.contacts for place in fields.entry.places]


def squared_contributions(solution: Solution) -> FloatArray:
    """The squared contributions (k,) of the owned cells to the error; only their ratios count.

    With the locking stress, which alternates between cells on every mesh, they would lead to locked
    zones: they are those of the elastic stress.  They are zero where there is no estimate, as on a
    mesh that misses a foundation.
    """
    mesh, field = solution.domain.mesh, solution.elastic_error_indicator
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    if field is None:
        return np.zeros(owned)
    return np.asarray(field.x.array[field.function_space.dofmap.list[:owned, 0]] ** 2)


def cells_at(places: list[tuple[float, ...]], data: MeshData) -> BoolArray:
    """The cells (k,) that have one of some places."""
    corners = data.points[data.cells.nodes]
    found = np.zeros(len(corners), dtype=bool)
    inverse = np.linalg.inv((corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1))
    for place in places:
        rest = np.einsum("kij,kj->ki", inverse, np.array(place) - corners[:, 0])
        shares = np.column_stack([1.0 - rest.sum(axis=1), rest])
        found |= shares.min(axis=1) > _INSIDE
    return found


def refined(mesh: WholeMesh, marked: BoolArray, curved: tuple[Curved, ...] = ()) -> WholeMesh:
    """Bisect all edges of the marked cells, and as many others as a conforming mesh needs.

    Plaza's algorithm bisects the longest edge of every cell that it divides, which keeps the angles
    away from zero (doi:10.1016/S0168-9274(99)00022-7).  Regions, boundary parts and connected parts
    pass from a cell or facet to its children.  New nodes on ``curved`` sides are moved there; the
    other sides stay as they are.  ``marked`` (k,) are the marked cells.  For one process.

    Raises NotRefined if a cell would collapse as its new nodes move, or become too small.
    """
    data, parent = _bisected(mesh, marked)
    before = signed_measures(data.points, data.cells.nodes)
    if curved:
        nodes_of = partial(_nodes_of, data)
        data = replace(data, points=rounded(curved, data.points, nodes_of))
        after = signed_measures(data.points, data.cells.nodes)
        if np.any(after / before < 1.0 - _LARGEST_LOSS):
            raise NotRefined(
                "the first mesh is too coarse at a curved side: a cell would collapse as its new "
                "nodes move onto the side; make mesh.h smaller"
            )
    smallest = float(longest_edges(data.points, data.cells.nodes).min())
    if smallest < _SMALLEST_SHARE * float(np.ptp(data.points, axis=0).max()):
        raise NotRefined(f"the smallest cells, of {smallest:.1e}, are near the rounding")
    return replace(mesh, data=data, parts=mesh.parts[parent])


def _bisected(mesh: WholeMesh, marked: BoolArray) -> tuple[MeshData, IntArray]:
    """The mesh with straight new edges, and the parent (k,) of each cell."""
    old, dim = mesh.data, mesh.data.dim
    domain = spread(mesh, MPI.COMM_SELF)
    coarse = domain.mesh
    original = np.asarray(coarse.topology.original_cell_index, dtype=np.int64)
    coarse.topology.create_entities(1)
    coarse.topology.create_connectivity(dim, 1)
    cells = np.flatnonzero(marked[original]).astype(np.int32)
    edges = dmesh.compute_incident_entities(coarse.topology, cells, dim, 1)
    option = dmesh.RefinementOption.parent_cell_and_facet
    fine, parent, facet = dmesh.refine(coarse, edges, None, option)
    topology = fine.topology
    topology.create_connectivity(dim - 1, dim)
    topology.create_connectivity(dim, dim - 1)
    tags = dmesh.transfer_meshtag(domain.facet_tags, fine, parent, facet)
    # DOLFINx numbers the cells anew after the refinement, and ``parent`` has the numbers before.
    order = np.argsort(topology.original_cell_index)
    of = original[parent]
    data = MeshData(
        dim,
        np.array(fine.geometry.x[:, :dim]),
        np.arange(len(fine.geometry.x)),
        elements(_compat.cell_nodes(fine)[order], old.cells.groups[of], old.cells.names),
        elements(
            _compat.entities_to_geometry(fine, dim - 1, tags.indices),
            tags.values,
            domain.facet_names,
        ),
    )
    return data, of


def _nodes_of(data: MeshData, name: str) -> BoolArray:
    """The nodes (m,) of a boundary part or a region; none if there is no such group."""
    mask = np.zeros(len(data.points), dtype=bool)
    for group in (data.facets, data.cells):
        mask[group.nodes[group.named(name)]] = True
    return mask


def finer_mesh(
    domain: Domain,
    solution: Solution,
    marks: Callable[[MeshData], BoolArray],
    most: int,
    curved: tuple[Curved, ...],
) -> Domain:
    """The mesh ``domain`` of a solution with the cells ``marks`` (k,) refined; collective.

    ``marks`` is called on rank 0.  ``most`` is the largest number of unknowns.  Default radii
    of smoothing stay those of the first mesh, and ``curved`` sides stay curved.  Raises NotRefined,
    on all ranks.
    """
    mesh = gather_mesh(domain)
    radii = domain.smoothing_radii or {
        one.contact.key: default_radius(one.surface) for one in solution.contacts
    }
    held: list[WholeMesh] = []

    def work() -> None:
        assert mesh is not None
        finer = refined(mesh, marks(mesh.data), curved)
        held.append(replace(finer, facts={**finer.facts, "smoothing_radii": radii}))

    on_root(domain.comm, work)
    finer = spread(held[0] if held else None, domain.comm)
    dofmap = solution.element.displacement_space(finer.mesh).dofmap
    dofs = int(dofmap.index_map.size_global * dofmap.index_map_bs)
    if dofs > most:
        raise NotRefined(f"the next mesh has {dofs} unknowns, more than adapt.max_dofs")
    return finer
