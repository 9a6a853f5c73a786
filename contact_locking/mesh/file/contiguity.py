"""The check that neighbouring cells share nodes: duplicate nodes and hanging nodes.

Only nodes of the boundary, which consists of the facets of a single cell, need the check.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.mesh.file import places
from contact_locking.mesh.file.data import MeshData
from contact_locking.mesh.file.topology import longest_edges

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

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
) -> list[str]:
    """Raise InputError where parts touch without shared nodes, or a node hangs on a facet.

    ``boundary`` (f, n) are the facets of a single cell, as nodes of ``mesh``, ``owner`` (f,) these
    cells and ``parts`` (f,) the parts of the cells.  Other cells and nodes of the mesh may be
    missing.  Returns warnings of cracks.
    """
    from scipy.spatial import cKDTree

    facet = mesh.kind.facet
    boundary = facet.split(boundary)
    owner, parts = (np.repeat(values, len(facet.simplices)) for values in (owner, parts))
    size = longest_edges(mesh.points, boundary)
    nodes = np.unique(boundary)
    part = np.empty(len(mesh.points), dtype=np.int64)
    part[boundary] = parts[:, None]
    tree = cKDTree(mesh.points[nodes])
    warnings = _cracks(mesh, nodes, part, tree, float(size.min()), facing)
    _check_hanging(mesh, nodes, tree, boundary, owner, size, facing)
    return warnings


def _may_meet(facing: Facing, one: IntArray, other: IntArray, beside: BoolArray) -> BoolArray:
    """(k,) whether nodes ``one`` (k,) and those ``beside`` (k, n) are on facing sides.

    They are the marked ones of ``other`` (k, n).
    """
    found = np.zeros(len(one), dtype=bool)
    for pair in facing:
        for a, b in (pair, pair[::-1]):
            found |= a[one] & (b[other] | ~beside).all(axis=1)
    return found


def _cracks(
    mesh: MeshData,
    nodes: IntArray,
    part: IntArray,
    tree: cKDTree,
    size: float,
    facing: Facing,
) -> list[str]:
    """A warning of double nodes in one part; raises InputError for those of two parts."""
    # The nearest neighbour suffices, and the number of nodes at one place has no bound.
    distance, near = tree.query(tree.data, k=2, distance_upper_bound=_SAME_PLACE * size)
    # Of several nodes at one place, a node need not be the first in the list of its own neighbours.
    own = np.arange(len(nodes))
    other = np.where(near[:, 0] == own, near[:, 1], near[:, 0])
    double = np.isfinite(distance[:, 1])
    there = nodes[np.minimum(other, len(nodes) - 1)][:, None]
    double &= ~_may_meet(facing, nodes, there, np.ones(there.shape, dtype=bool))
    if not double.any():
        return []
    pairs = np.column_stack([nodes[double], nodes[other[double]]])
    apart = part[pairs[:, 0]] != part[pairs[:, 1]]
    chosen = pairs[apart] if apart.any() else pairs
    one, two = sorted(chosen[0])
    said = (
        f"nodes {mesh.numbers[one]} and {mesh.numbers[two]} are both at "
        f"{places.at(mesh.points[one])}"
    )
    rest = len(np.unique(chosen)) - 2
    said += f", and {rest} more nodes" if rest else ""
    if apart.any():
        raise InputError(
            f"two parts of the body touch and share no nodes: {said}; {_FRAGMENT}, or leave a gap"
        )
    return [
        f"the body is cut where nodes are double: {said}; unless it is meant to be, {_FRAGMENT}"
    ]


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
    more = np.flatnonzero(count > mesh.dim)
    lists = tree.query_ball_point(middle[more], reach[more])
    if not len(more):
        return
    facet = np.repeat(more, [len(found) for found in lists])
    node = nodes[np.concatenate([np.asarray(found, dtype=np.int64) for found in lists])]
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
        f"{places.node(mesh, int(node[first]))} hangs: it lies on {article} {what} of "
        f"{mesh.kind.name} {number} ({places.nodes(mesh, boundary[facet[first]])}), and is "
        f"none of its corners{places.more(len(np.unique(node[hanging])))}, so that the body would "
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
