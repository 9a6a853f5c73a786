"""Solve, estimate, mark, refine, until the error is below the tolerance.

1. Solve on the mesh, the first time on the given mesh.
2. Estimate the relative error, and stop if it is small enough or if a limit is reached.
3. Mark the fewest cells that have a given share of the squared error, and those where a foundation
   enters between the nodes.
4. Refine the marked cells, and begin again.
"""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from dolfinx import mesh as dmesh
from mpi4py import MPI

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.certificate.laws import ENTRY
from contact_locking.contact.coulomb import default_radius
from contact_locking.errors import InputError, NotRefined
from contact_locking.findings import Finding
from contact_locking.mesh.data import MeshData, longest_edges, point_words, signed_measures
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.parts import NamedFacets
from contact_locking.mesh.sources import WholeMesh, elements, gather_cells, gather_mesh, spread
from contact_locking.meshes.geometry import Curved, rounded
from contact_locking.parallel import on_root
from contact_locking.results.solution import Solution
from contact_locking.solver.monitor import Monitor
from contact_locking.solver.settings import Adaptation

S = TypeVar("S", bound=Solution)
# The error has to fall below this share of itself in so many meshes.
_LEAST_FALL, _MESHES = 0.95, 4


def adapted(
    solve_on: Callable[[Domain], S],
    domain: Domain,
    adaptation: Adaptation,
    monitor: Monitor,
    curved: tuple[Curved, ...] = (),
) -> Iterator[S]:
    """The solutions on adapted meshes, the first of them ``domain``; collective.

    ``curved`` are sides onto which new nodes move.  Raises InputError for cells that DOLFINx does
    not refine.
    """
    if not domain.kind.is_simplex:
        raise InputError(
            f"DOLFINx refines simplices only, and the mesh has {domain.kind.plural}; take "
            "triangles or tetrahedra (mesh.cells: simplex), or leave out adapt",
            "adapt",
        )
    meshes: list[dict[str, Any]] = []
    began = since = time.perf_counter()
    finer: Domain | None = domain
    while finer is not None:
        domain = finer
        solution = solve_on(domain)
        assert solution.report is not None
        now, tangents = time.perf_counter(), solution.report.tangents
        error = solution.certificate.errors["mesh"]["relative"]
        sizes = {name: solution.facts[name] for name in ("dofs", "cells")}
        effort = {"estimate": error, "tangents": tangents, "seconds": now - since}
        meshes.append(sizes | effort)
        shown = "no error" if error is None else f"estimate {100.0 * error:.3g} %"
        words = f"{sizes['dofs']} unknowns, {shown}, {tangents} tangents, {now - since:.1f} s"
        since = now
        is_reached, stopped = _end(solution, adaptation)
        if len(meshes) >= adaptation.max_meshes:
            stopped = stopped or f"adapt.max_meshes, {adaptation.max_meshes}, is reached"
        errors = [entry["estimate"] for entry in meshes[-_MESHES:]]
        stagnates = len(errors) == _MESHES and None not in errors
        stagnates = stagnates and errors[-1] > _LEAST_FALL * errors[0]
        try:
            finer = None
            if not stopped:
                finer = _refined(domain, solution, adaptation, stagnates, curved)
        except NotRefined as reason:
            stopped = str(reason)
        monitor.mesh(len(meshes), words)
        if stopped and not is_reached:
            finding = Finding("adapt.stopped", reason=stopped)
            solution = solution.with_warnings(finding)
            monitor.message(f"warning: {finding}")
        about = {
            "tolerance": adaptation.tolerance,
            "reached": is_reached,
            "stopped": stopped or None,
        }
        yield solution.with_entries(
            adapt={**about, "meshes": [dict(entry) for entry in meshes]},
            wall_seconds=time.perf_counter() - began,
        )


def _end(solution: Solution, adaptation: Adaptation) -> tuple[bool, str]:
    """Whether the mesh is fine enough, and why the loop ends here, empty if it goes on."""
    estimate, criteria = solution.certificate.errors["mesh"], solution.certificate.criteria
    broken = {name for name, criterion in criteria.items() if not criterion.holds}
    if entered_places(solution) and (solution.converged or broken == {ENTRY}):
        # No error on this mesh tells of a foundation that enters between the nodes.
        return False, ""
    if not solution.converged:
        return False, "the solve on this mesh did not converge"
    if estimate["relative"] is None:
        # A body at rest has no relative error.
        if solution.facts["elastic_energy"] == 0.0:
            return True, "the body is at rest"
        return False, f"no error: {estimate.get('reason')}"
    if estimate["relative"] <= adaptation.tolerance:
        return True, "the estimate is below the tolerance"
    return False, ""


def _refined(
    domain: Domain,
    solution: Solution,
    adaptation: Adaptation,
    stagnates: bool,
    curved: tuple[Curved, ...],
) -> Domain:
    """The next mesh; collective.  Raises NotRefined, on all ranks.

    Default radii of smoothing stay those of the first mesh, and ``curved`` sides stay curved.
    """
    squares = gather_cells(domain, squared_contributions(solution))
    mesh, entered, next_meshes = gather_mesh(domain), entered_places(solution), list[WholeMesh]()
    radii = domain.smoothing_radii or {
        fields.contact.key: default_radius(fields.surface) for fields in solution.contacts
    }

    def refine() -> None:
        assert mesh is not None and squares is not None
        data = mesh.data
        if stagnates and not entered:
            sizes = longest_edges(data.points, data.cells.nodes)
            least = int(np.argmin(sizes))
            centre = point_words(data.points[data.cells.nodes[least]].mean(axis=0))
            raise NotRefined(
                "the error has hardly fallen over the last meshes; the smallest cells, of size "
                f"{sizes[least]:.2g}, are at {centre}, where the solution may be singular"
            )
        marks = marked_cells(squares, adaptation.share) | cells_at(entered, data)
        finer = refined(mesh, marks, curved)
        next_meshes.append(replace(finer, facts={**finer.facts, "smoothing_radii": radii}))

    on_root(domain.comm, refine)
    finer = spread(next_meshes[0] if next_meshes else None, domain.comm)
    dofmap = solution.element.displacement_space(finer.mesh).dofmap
    dofs = int(dofmap.index_map.size_global * dofmap.index_map_bs)
    if dofs > adaptation.max_dofs:
        raise NotRefined(f"the next mesh has {dofs} unknowns, more than adapt.max_dofs")
    return finer


def adapt(
    make_problem: Callable[..., Any],
    tolerance: float,
    mesh: dmesh.Mesh,
    tags: dmesh.MeshTags | None = None,
    cells: dmesh.MeshTags | None = None,
    **limits: float,
) -> Iterator[Solution]:
    """Solutions on finer meshes until ``|u - u_h|_a <= tolerance |u|_a`` by estimate; collective.

    The estimate is ``certificate.errors.mesh`` of the summary, which has the meshes so far and the
    reason for the end as ``adapt``.  Raises InputError for a mesh of other cells than simplices.

    Parameters
    ----------
    make_problem
        ``make_problem(mesh)`` returns the ContactProblem on a mesh; it gets ``tags`` and ``cells``
        of this mesh as further arguments, where the first mesh has them; R of friction needs a
        radius, as its default is that of the mesh
    tolerance
        the relative error at which the mesh is fine enough
    mesh, tags, cells
        the first mesh, tags of facets on its boundary and tags of its cells, which pass to finer
        meshes
    limits
        ``share``, ``max_dofs`` and ``max_meshes`` of :class:`Adaptation`
    """
    adaptation = Adaptation(tolerance=tolerance, **limits)
    names, regions = (
        {str(value): value for value in _values(new_tags, mesh)} for new_tags in (tags, cells)
    )
    places = NamedFacets(mesh, tags, names)
    for name in names:
        places.add(name, "tags")
    domain = places.domain()
    if cells is not None:
        numbers = domain.cell_tags.values.copy()
        # A cell without a tag has the number 0, which may be a tag of others.
        numbers[cells.indices] = 1 + np.searchsorted([*regions.values()], cells.values)
        new_tags = dmesh.meshtags(mesh, domain.dim, domain.cell_tags.indices, numbers)
        named = {name: number for number, name in enumerate(regions, start=1)}
        domain = dataclasses.replace(domain, cell_tags=new_tags, cell_names=named)

    def solve_on(domain: Domain) -> Solution:
        made, known = [], domain.facet_names
        facets = {mark: names[name] for name, marks in known.items() for mark in marks}
        in_cells = {number: regions[name] for name, number in domain.cell_names.items()}
        for user_tags, dim, fresh, values in (
            (tags, domain.dim - 1, domain.facet_tags, facets),
            (cells, domain.dim, domain.cell_tags, in_cells),
        ):
            if user_tags is not None:
                tagged = np.isin(fresh.values, [*values])
                marks = np.array([values[mark] for mark in fresh.values[tagged]], dtype=np.int32)
                made.append(dmesh.meshtags(domain.mesh, dim, fresh.indices[tagged], marks))
        problem = make_problem(domain.mesh, *made)
        if problem.domain.mesh is not domain.mesh:
            raise InputError("must return a problem on the mesh passed to it", "make_problem")
        with contextlib.closing(problem):
            return problem.solve()

    return adapted(solve_on, domain, adaptation, Monitor())


def _values(tags: dmesh.MeshTags | None, mesh: dmesh.Mesh) -> list[int]:
    """The values of tags, the same on all ranks; collective."""
    values = set[int]() if tags is None else {int(value) for value in tags.values}
    return sorted(set().union(*mesh.comm.allgather(values)))


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
    marks = np.zeros(len(corners), dtype=bool)
    inverse = np.linalg.inv((corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1))
    for place in places:
        others = np.einsum("kij,kj->ki", inverse, np.array(place) - corners[:, 0])
        shares = np.column_stack([1.0 - others.sum(axis=1), others])
        marks |= shares.min(axis=1) > _INSIDE
    return marks


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
