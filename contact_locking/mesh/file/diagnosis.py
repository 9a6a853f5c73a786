"""The check of the arrays of a mesh for what DOLFINx needs: each rank has a share of the arrays.

DOLFINx needs cells that occur once, of different nodes, and facets of two cells at most.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.mesh.file import places
from contact_locking.mesh.file.data import MeshData
from contact_locking.mesh.file.topology import keys
from contact_locking.parallel import agree


class _Defect(NamedTuple):
    """Nodes (n,) that ``cells`` (k,), by their numbers, share wrongly, the first of ``defects``.

    ``numbers`` and ``centre`` are those of the nodes, in words.
    """

    nodes: IntArray
    cells: IntArray
    defects: int
    numbers: str = ""
    centre: str = ""


def check_arrays(comm: MPI.Intracomm, share: MeshData) -> None:
    """Raise InputError, on all ranks, for arrays that are no mesh; collective.

    ``share`` has this rank's share of points and of cells, which name the points of all ranks; the
    points are counted rank after rank.
    """
    kind, cells = share.kind, share.cells
    agree(comm, lambda: _check_coordinates(share))
    corners = np.sort(cells.nodes, axis=1)
    twice = np.flatnonzero((corners[:, 1:] == corners[:, :-1]).any(axis=1))
    own = None
    if len(twice):
        own = _Defect(cells.nodes[twice[0]], cells.numbers[twice[:1]], len(twice))
    if found := _first(comm, share, own):
        raise InputError(
            f"{kind.name} {found.cells[0]} at {found.centre} has the same node twice"
            f"{places.more(found.defects)}"
        )
    total = comm.allreduce(len(share.points))
    if found := _first(comm, share, _shared(comm, corners, cells.numbers, 1, total)):
        one, other = found.cells[:2]
        raise InputError(
            f"{kind.name} {other} is {kind.name} {one} once more, at {found.centre}: they have the "
            f"same nodes{places.more(found.defects)}; remove the duplicates (in Gmsh "
            "gmsh.model.mesh.removeDuplicateElements)"
        )
    facets = np.sort(kind.facets_of(cells.nodes), axis=1)
    numbers = np.tile(cells.numbers, len(kind.facets))
    if found := _first(comm, share, _shared(comm, facets, numbers, 2, total)):
        raise InputError(
            f"{len(found.cells)} {kind.plural} share one {'edge' if kind.dim == 2 else 'face'} "
            f"(nodes {found.numbers} at {found.centre}): {places.listed(found.cells)}"
            f"{places.more(found.defects)}; at most two can, as cells do not overlap"
        )


def _check_coordinates(mesh: MeshData) -> None:
    bad = ~np.isfinite(mesh.points).all(axis=1)
    if bad.any():
        raise InputError(
            f"the coordinates of {places.node(mesh, int(np.argmax(bad)))} are not finite numbers"
            f"{places.more(int(bad.sum()))}"
        )


def _shared(
    comm: MPI.Intracomm, rows: IntArray, numbers: IntArray, most: int, total: int
) -> _Defect | None:
    """The first of the rows (k, n) of nodes that more than ``most`` cells have; collective.

    Each rank judges the rows of all ranks whose first node it is in charge of.
    """
    rank = rows[:, 0] * comm.size // max(total, 1)
    order = np.argsort(rank, kind="stable")
    ends = np.searchsorted(rank[order], np.arange(1, comm.size))
    whole = np.column_stack([rows, numbers])[order]
    whole = np.concatenate(comm.alltoall(np.split(whole, ends)))
    values = keys(whole[:, :-1], total)
    _, first, count = np.unique(values, return_index=True, return_counts=True)
    many = first[count > most]
    if not len(many):
        return None
    cells = np.sort(whole[values == values[many[0]], -1])
    return _Defect(whole[many[0], :-1], cells, len(many))


def _first(comm: MPI.Intracomm, share: MeshData, own: _Defect | None) -> _Defect | None:
    """The first of the defects of all ranks, with the number of all and its words; collective."""
    found = [defect for defect in comm.allgather(own) if defect is not None]
    if not found:
        return None
    nodes, count = found[0].nodes, sum(defect.defects for defect in found)
    local = nodes - (comm.exscan(len(share.points)) or 0)
    here = (local >= 0) & (local < len(share.points))
    numbers: IntArray = np.zeros(len(nodes), dtype=np.int64)
    points: FloatArray = np.zeros((len(nodes), share.dim))
    numbers[here], points[here] = share.numbers[local[here]], share.points[local[here]]
    words = places.listed(comm.allreduce(numbers))
    centre = places.at(comm.allreduce(points).mean(axis=0))
    return found[0]._replace(defects=count, numbers=words, centre=centre)
