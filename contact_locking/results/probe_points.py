"""The points of the probes, and the cells of the mesh that contain the points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from dolfinx import geometry
from dolfinx import mesh as dmesh
from mpi4py import MPI

from contact_locking import _compat
from contact_locking.arrays import FloatArray, IndexArray, IntArray
from contact_locking.errors import InputError
from contact_locking.mesh.domain import Domain
from contact_locking.results.output import Probe
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
    probe, both from 0.  Each point belongs to one cell of one rank: ``own`` (m,) are the points of
    this rank, and ``cells`` (m,) are their cells.
    """

    x: FloatArray
    probe: IntArray
    number: IntArray
    own: IntArray
    cells: IndexArray

    def __len__(self) -> int:
        return len(self.x)


@dataclass(frozen=True)
class ProbeSample:
    """The fields at all k points at one time.

    ``values`` maps the name of a column to (k,) on rank 0 and to nothing on the other ranks.
    ``step`` counts from 1; it is 0 without steps.
    """

    points: ProbePoints
    values: dict[str, FloatArray]
    step: int = 0
    time: float = 0.0


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
    own = np.flatnonzero((first == whole) & (first != _NONE))
    return ProbePoints(
        x,
        np.array([index for index, *_ in listed], dtype=np.int64),
        np.array([number for _, number, *_ in listed], dtype=np.int64),
        own.astype(np.int64),
        cells[own],
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
    found = geometry.compute_collisions_points(tree, places)
    corners = nodes[_compat.cell_corners(mesh)]
    for point in range(len(x)):
        candidates = found.links(point)
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
