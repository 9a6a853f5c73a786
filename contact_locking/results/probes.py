"""The points of the probes, the cells that contain them, and the fields there: probes.csv."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from dolfinx import fem, geometry
from dolfinx import mesh as dmesh
from mpi4py import MPI

from contact_locking import _compat
from contact_locking.arrays import AXES, FloatArray, IndexArray, IntArray
from contact_locking.errors import InputError
from contact_locking.mesh.domain import Domain
from contact_locking.results.output import Probe
from contact_locking.results.solution import Solution
from contact_locking.results.table import Table
from contact_locking.values.concept import dotted

# A point is in a cell if it is off the reference cell by this share at most.  Rounding alone
# must not take a point of the boundary out of the body.
_MARGIN = 1e-9
# The number of no cell.
_NONE = np.iinfo(np.int64).max


@dataclass(frozen=True)
class ProbePoints:
    """The k points ``x`` (k, d) of all probes, the same on all ranks.

    ``probe`` (k,) is the number of the probe and ``number`` (k,) the number of the point in the
    probe, both from 0.  Each point belongs to one cell of one rank: ``owned`` (m,) are the points
    of this rank, and ``cells`` (m,) are their cells.
    """

    x: FloatArray
    probe: IntArray
    number: IntArray
    owned: IntArray
    cells: IndexArray

    def __len__(self) -> int:
        return len(self.x)


def locate(domain: Domain, probes: Sequence[Probe]) -> ProbePoints:
    """The points of the probes in a mesh; collective.

    If several cells contain a point, such as a node, the point belongs to the cell that comes
    first in the whole mesh.  Raises InputError with the key for a point outside of the body.
    """
    listed = [
        (index, number, place, point)
        for index, probe in enumerate(probes)
        for number, (place, point) in enumerate(probe.places())
    ]
    x = np.array([point for *_, point in listed], dtype=float).reshape(-1, domain.dim)
    first, cells = _first_cells(domain, x)
    whole = np.empty_like(first)
    domain.comm.Allreduce(first, whole, op=MPI.MIN)
    for (index, number, place, point), cell in zip(listed, whole, strict=True):
        if cell == _NONE:
            shown = ", ".join(f"{value:g}" for value in point)
            key = dotted("output", "probes", index, *place)
            which = f"point {number}, at ({shown})," if place == ("line",) else f"({shown})"
            raise InputError(f"{which} is outside of the mesh of the body", key)
    owned = np.flatnonzero((first == whole) & (first != _NONE))
    return ProbePoints(
        x,
        np.array([index for index, *_ in listed], dtype=np.int64),
        np.array([number for _, number, *_ in listed], dtype=np.int64),
        owned.astype(np.int64),
        cells[owned],
    )


def _first_cells(domain: Domain, x: FloatArray) -> tuple[IntArray, IndexArray]:
    """The number in the whole mesh of the first owned cell with each point, and its local number.

    The number is `_NONE` where no owned cell contains the point.
    """
    mesh, dim = domain.mesh, domain.dim
    first = np.full(len(x), _NONE, dtype=np.int64)
    cells = np.zeros(len(x), dtype=np.int32)
    owned = mesh.topology.index_map(dim).size_local
    if not len(x) or not owned:
        return first, cells
    entities = np.arange(owned, dtype=np.int32)
    original = np.asarray(mesh.topology.original_cell_index, dtype=np.int64)
    nodes = mesh.geometry.x[:, :dim]
    padding = _MARGIN * float(np.ptp(nodes, axis=0).max())
    tree = geometry.bb_tree(mesh, dim, entities=entities, padding=padding)
    places = np.zeros((len(x), 3))
    places[:, :dim] = x
    collisions = geometry.compute_collisions_points(tree, places)
    corners = nodes[_compat.cell_corners(mesh)]
    for point in range(len(x)):
        candidates = collisions.links(point)
        local = np.array([_pulled_back(mesh, corners[cell], x[point]) for cell in candidates])
        inside = domain.kind.room(local.reshape(-1, dim)) >= -_MARGIN
        if inside.any():
            inner = candidates[inside]
            cells[point] = inner[np.argmin(original[inner])]
            first[point] = original[cells[point]]
    return first, cells


def _pulled_back(mesh: dmesh.Mesh, corners: FloatArray, place: FloatArray) -> FloatArray:
    """The point (d,) of the reference cell for a place (d,) near the cell with corners (c, d)."""
    try:
        return np.asarray(_compat.coordinate_map(mesh).pull_back(place[None], corners)[0])
    except RuntimeError:  # Newton's method does not converge for places far off a distorted cell
        return np.full(len(place), np.inf)


def sample(points: ProbePoints, solution: Solution) -> Table:
    """The fields at the points, a row for each, on rank 0; empty elsewhere; collective.

    The columns ``stress`` are the whole stress, ``A eps(u) + Z``, with the hoop stress of an
    axisymmetric body.
    """
    dim, size = points.x.shape[1], solution.elastic_stress.ufl_shape[0]
    axes = AXES[:dim]
    pairs = {f"{axes[i]}{axes[j]}": (i, j) for i in range(dim) for j in range(i, dim)}
    if size > dim:
        pairs["hoop"] = (dim, dim)
    components = [i * size + j for i, j in pairs.values()]
    names = [
        *(f"u_{axis}" for axis in axes),
        "strain_norm",
        *(f"stress_{pair}" for pair in pairs),
        *(f"locking_stress_{pair}" for pair in pairs),
    ]
    stresses = (solution.elastic_stress, solution.locking_stress)
    elastic, locking = (_local_values(points, field) for field in stresses)
    local = np.column_stack(
        [
            _local_values(points, solution.displacement),
            _local_values(points, solution.strain_norm),
            (elastic + locking)[:, components],
            locking[:, components],
        ]
    )
    gathered = solution.domain.comm.gather((points.owned, local))
    if gathered is None:
        return Table()
    values = np.empty((len(points), len(names)))
    for numbers, of_rank in gathered:
        values[numbers] = of_rank
    places = {"probe": points.probe, "point": points.number}
    places |= zip(AXES, points.x.T, strict=False)
    units = dict.fromkeys([*axes, *(f"u_{axis}" for axis in axes)], "length")
    units |= {name: "stress" for name in names if "stress" in name}
    return Table(places | dict(zip(names, values.T, strict=True)), units)


def in_step(sampled: Table, step: int, time: float) -> Table:
    """The table with the columns ``step``, from 1, and ``t``; as it is for step 0."""
    every = np.ones(len(sampled), dtype=np.int64)
    when = {"step": step * every, "t": time * every} if step and len(sampled) else {}
    return Table(when | sampled.columns, sampled.units)


def _local_values(points: ProbePoints, field: fem.Function) -> FloatArray:
    """The values (m, n) of a field at the m points of this rank."""
    size = int(np.prod(field.ufl_shape, dtype=int))
    places = np.zeros((len(points.owned), 3))
    places[:, : points.x.shape[1]] = points.x[points.owned]
    if not len(places):
        return np.empty((0, size))
    return np.asarray(field.eval(places, points.cells)).reshape(len(places), size)
