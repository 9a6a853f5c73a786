"""Checks of the arrays of a mesh: what DOLFINx needs, and that neighbouring cells share nodes.

DOLFINx needs cells that occur once, of different nodes, and facets of two cells at most.  Duplicate
and hanging nodes are looked for on the boundary, which consists of the facets of a single cell.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.findings import Finding
from contact_locking.mesh.cell_kind import keys, longest_edges
from contact_locking.mesh.data import MeshData, and_more, listed, point_words
from contact_locking.parallel import agree

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


class _Defect(NamedTuple):
    """Nodes (n,) that ``cells`` (k,), by their numbers, share wrongly, the first of ``total``.

    ``numbers`` and ``centre`` are those of the nodes, in words.
    """

    nodes: IntArray
    cells: IntArray
    total: int
    numbers: str = ""
    centre: str = ""


def check_arrays(comm: MPI.Intracomm, share: MeshData) -> None:
    """Raise InputError, on all ranks, for arrays that are no mesh; collective.

    ``share`` has this rank's share of points and of cells, which name the points of all ranks; the
    points are counted rank after rank.
    """
    kind, cells = share.kind, share.cells

    def check_coordinates() -> None:
        bad = ~np.isfinite(share.points).all(axis=1)
        if bad.any():
            raise InputError(
                f"the coordinates of {share.node_words(int(np.argmax(bad)))} are not finite numbers"
                f"{and_more(int(bad.sum()))}"
            )

    agree(comm, check_coordinates)
    corners = np.sort(cells.nodes, axis=1)
    twice = np.flatnonzero((corners[:, 1:] == corners[:, :-1]).any(axis=1))
    defects = [_Defect(cells.nodes[i], cells.numbers[[i]], len(twice)) for i in twice[:1]]
    if defect := _first(comm, share, defects):
        raise InputError(
            f"{kind.name} {defect.cells[0]} at {defect.centre} has the same node twice"
            f"{and_more(defect.total)}"
        )
    if defect := _first(comm, share, _shared(comm, share, corners, cells.numbers, 1)):
        first, other = defect.cells[:2]
        raise InputError(
            f"{kind.name} {other} is {kind.name} {first} once more, at {defect.centre}: they have "
            f"the same nodes{and_more(defect.total)}; remove the duplicates (in Gmsh "
            "gmsh.model.mesh.removeDuplicateElements)"
        )
    facets = np.sort(kind.facets_of(cells.nodes), axis=1)
    numbers = np.tile(cells.numbers, len(kind.facets))
    if defect := _first(comm, share, _shared(comm, share, facets, numbers, 2)):
        raise InputError(
            f"{len(defect.cells)} {kind.plural} share one {'edge' if kind.dim == 2 else 'face'} "
            f"(nodes {defect.numbers} at {defect.centre}): {listed(defect.cells)}"
            f"{and_more(defect.total)}; at most two can, as cells do not overlap"
        )


def _shared(
    comm: MPI.Intracomm, share: MeshData, rows: IntArray, numbers: IntArray, most: int
) -> list[_Defect]:
    """The first of the rows (k, n) of nodes that more than ``most`` cells have; collective.

    Each rank judges the rows of all ranks whose first node it is in charge of.
    """
    total = comm.allreduce(len(share.points))
    rank = rows[:, 0] * comm.size // max(total, 1)
    order = np.argsort(rank, kind="stable")
    ends = np.searchsorted(rank[order], np.arange(1, comm.size))
    whole = np.column_stack([rows, numbers])[order]
    whole = np.concatenate(comm.alltoall(np.split(whole, ends)))
    values = keys(whole[:, :-1], total)
    _, first, count = np.unique(values, return_index=True, return_counts=True)
    many = first[count > most]
    cells = [np.sort(whole[values == values[row], -1]) for row in many[:1]]
    return [_Defect(whole[many[0], :-1], some, len(many)) for some in cells]


def _first(comm: MPI.Intracomm, share: MeshData, local: list[_Defect]) -> _Defect | None:
    """The first of the defects of all ranks, with the number of all and its words; collective."""
    defects = list(itertools.chain(*comm.allgather(local)))
    if not defects:
        return None
    nodes = defects[0].nodes
    rows = nodes - (comm.exscan(len(share.points)) or 0)
    mine = (rows >= 0) & (rows < len(share.points))
    numbers: IntArray = np.zeros(len(nodes), dtype=np.int64)
    points: FloatArray = np.zeros((len(nodes), share.dim))
    numbers[mine], points[mine] = share.numbers[rows[mine]], share.points[rows[mine]]
    words = listed(comm.allreduce(numbers))
    centre = point_words(comm.allreduce(points).mean(axis=0))
    total = sum(defect.total for defect in defects)
    return defects[0]._replace(total=total, numbers=words, centre=centre)


# Nodes are at one place if they are nearer than this share of a facet: files hold rounded numbers.
_SAME_PLACE = 1e-5
_FRAGMENT = (
    "make one mesh of what meets there (fragment in Gmsh before it is meshed, or "
    "gmsh.model.mesh.removeDuplicateNodes)"
)


#: Marks of nodes (m,) on both sides of boundary parts that may touch each other.
Facing = Sequence[tuple[BoolArray, BoolArray]]


def check_boundary(
    mesh: MeshData, boundary: IntArray, owner: IntArray, parts: IntArray, facing: Facing
) -> list[Finding]:
    """Raise InputError where parts touch without shared nodes, or a node hangs on a facet.

    ``boundary`` (f, n) are the facets of a single cell, as nodes of ``mesh``, ``owner`` (f,) these
    cells and ``parts`` (f,) the parts of the cells.  Other cells and nodes of the mesh may be
    missing.  Returns findings of cracks.
    """
    from scipy.spatial import cKDTree

    facet = mesh.kind.facet
    boundary = facet.split(boundary)
    owner, parts = (np.repeat(values, len(facet.simplices)) for values in (owner, parts))
    size = longest_edges(mesh.points, boundary)
    nodes = np.unique(boundary)
    bodies = np.empty(len(mesh.points), dtype=np.int64)
    bodies[boundary] = parts[:, None]
    tree = cKDTree(mesh.points[nodes])
    findings = _cracks(mesh, nodes, bodies, tree, float(size.min()), facing)
    _check_hanging(mesh, nodes, tree, boundary, owner, size, facing)
    return findings


def _may_meet(facing: Facing, first: IntArray, other: IntArray, beside: BoolArray) -> BoolArray:
    """(k,) whether nodes ``first`` (k,) and those ``beside`` (k, n) are on facing sides.

    They are the marked ones of ``other`` (k, n).
    """
    may = np.zeros(len(first), dtype=bool)
    for pair in facing:
        for a, b in (pair, pair[::-1]):
            may |= a[first] & (b[other] | ~beside).all(axis=1)
    return may


def _cracks(
    mesh: MeshData, nodes: IntArray, bodies: IntArray, tree: cKDTree, size: float, facing: Facing
) -> list[Finding]:
    """The finding of double nodes in one part; raises InputError for those of two parts."""
    # The nearest neighbour suffices, and the number of nodes at one place has no bound.
    distance, near = tree.query(tree.data, k=2, distance_upper_bound=_SAME_PLACE * size)
    # Of several nodes at one place, a node need not be the first in the list of its own neighbours.
    every = np.arange(len(nodes))
    other = np.where(near[:, 0] == every, near[:, 1], near[:, 0])
    double = np.isfinite(distance[:, 1])
    partner = nodes[np.minimum(other, len(nodes) - 1)][:, None]
    double &= ~_may_meet(facing, nodes, partner, np.ones(partner.shape, dtype=bool))
    if not double.any():
        return []
    pairs = np.column_stack([nodes[double], nodes[other[double]]])
    apart = bodies[pairs[:, 0]] != bodies[pairs[:, 1]]
    chosen = pairs[apart] if apart.any() else pairs
    first, two = sorted(chosen[0])
    said = (
        f"nodes {mesh.numbers[first]} and {mesh.numbers[two]} are both at "
        f"{point_words(mesh.points[first])}"
    )
    others = len(np.unique(chosen)) - 2
    said += f", and {others} more nodes" if others else ""
    if apart.any():
        raise InputError(
            f"two parts of the body touch and share no nodes: {said}; {_FRAGMENT}, or leave a gap"
        )
    return [Finding("mesh.cut", nodes=said, count=others + 2, advice=_FRAGMENT)]


def _check_hanging(
    mesh: MeshData,
    nodes: IntArray,
    tree: cKDTree,
    boundary: IntArray,
    owner: IntArray,
    size: FloatArray,
    facing: Facing,
) -> None:
    corners = mesh.points[boundary]
    middle = corners.mean(axis=1)
    reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    # The ball around a facet holds the corners of the facet, and seldom many other nodes.
    count = tree.query_ball_point(middle, reach, return_length=True)
    crowded = np.flatnonzero(count > mesh.dim)
    lists = tree.query_ball_point(middle[crowded], reach[crowded])
    if not len(crowded):
        return
    facet = np.repeat(crowded, [len(neighbours) for neighbours in lists])
    node = nodes[np.concatenate([np.asarray(neighbours, dtype=np.int64) for neighbours in lists])]
    keep = (node[:, None] != boundary[facet]).all(axis=1)
    facet, node = facet[keep], node[keep]
    inside, share = _inside(mesh.points[node], corners[facet], size[facet])
    # At the rim of a side nodes are on an edge of a facet beside the other one.
    meets = _may_meet(facing, node, boundary[facet], share > _SAME_PLACE)
    hanging = np.flatnonzero(inside & ~meets)
    if not len(hanging):
        return
    first = int(hanging[np.argmin(mesh.numbers[node[hanging]])])
    article, what = ("an", "edge") if mesh.dim == 2 else ("a", "face")
    number = mesh.cells.numbers[owner[facet[first]]]
    raise InputError(
        f"{mesh.node_words(int(node[first]))} hangs: it lies on {article} {what} of "
        f"{mesh.kind.name} {number} ({mesh.nodes_words(boundary[facet[first]])}), and is "
        f"none of its corners{and_more(len(np.unique(node[hanging])))}, so that the body would "
        f"be cut there; neighbours have to share whole {what}s: {_FRAGMENT}"
    )


def _inside(
    points: FloatArray, corners: FloatArray, size: FloatArray
) -> tuple[BoolArray, FloatArray]:
    """(k,) whether points (k, d) lie on facets with corners (k, d, d) without being a corner.

    Returns the barycentric coordinates (k, d) as well.
    """
    # In units of the size of the facet, so that no product underflows.
    edges = (corners[:, :-1] - corners[:, -1:]) / size[:, None, None]
    gram = np.einsum("kia,kja->kij", edges, edges)
    away = (points - corners[:, -1]) / size[:, None]
    right = np.einsum("kia,ka->ki", edges, away)
    inside = np.linalg.solve(gram, right[:, :, None])[:, :, 0]
    share = np.column_stack([inside, 1.0 - inside.sum(axis=1)])
    off = np.linalg.norm(away - np.einsum("ki,kia->ka", inside, edges), axis=1)
    on = (off <= _SAME_PLACE) & (share >= -_SAME_PLACE).all(axis=1)
    return on & (share <= 1.0 - 10 * _SAME_PLACE).all(axis=1), share
