"""How far two bodies that touch are from touching, by the geometry of their displaced facets alone.

The distance of a point x of one side to the facets of the other is ``|x - y|`` with the nearest
point y, negative inside of the other body, where ``(x - y) . n < 0`` with the outward normal n of
the facet of y.  It counts where y lies inside of the facet.  Points are the nodes of side 1 that
press, which should be at the distance zero, and a lattice on the facets of both sides, which should
not be inside.  The pressure of a quadratic node between corners belongs to a control value and acts
on the whole facet: of the nodes of its facets the nearest should be at zero.  Distances up to the
sagittae ``l theta/8`` of the chords do not count: the facets of a round side, of length l, turn by
theta from one to the next.  Of points inside, the sagitta of their own side does not count either,
but where no node of side 1 presses beside: there it has missed the other side, and no force acts.

Nothing here is shared with the gap, the pairing and the normals of the contact conditions.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.contact.pairing import Side

# The facets whose middles are so many nearest to a point may have the nearest point.
_NEAREST = 8
# The same where the points' own body has facets in the side as well.
_NEAREST_OF_ALL = 32
# Each edge of a facet is divided into so many parts.
_DIVISIONS = 4
# A point faces a facet if its way there is along the normal of the facet, to this cosine.
_ALONG = 0.99


def apart(
    presses: BoolArray, one: Side, other: Side, offset: float
) -> tuple[FloatArray, FloatArray]:
    """The distances (q,) that should not be, and the normals (q, d) of the facets there.

    ``presses`` (k,) marks the nodes of side 1 that press, and the sides are displaced.  ``offset``
    is the gap that adds to their distance.
    """
    of_node = np.zeros(len(one.points), dtype=np.int64)
    of_node[one.facets] = np.arange(len(one.facets))[:, None]
    distance, sagitta, nearest = _distances(one.points, one, of_node, other)
    away = np.abs(distance + offset) - sagitta
    lengths = [_least_of_facets(away, one)[presses]]
    normals = [other.outward[nearest][presses]]
    bears: BoolArray = np.any(presses[one.facets], axis=1)
    for side, facing in ((one, other), (other, one)):
        points, facet = _lattice(side)
        distance, sagitta, nearest = _distances(points, side, facet, facing)
        own = np.where(bears[facet if side is one else nearest], _sagittae(side)[facet], 0.0)
        lengths.append(-(distance + offset) - sagitta - own)
        normals.append(facing.outward[nearest])
    return np.concatenate(lengths), np.concatenate(normals)


def _least_of_facets(away: FloatArray, side: Side) -> FloatArray:
    """The values (k,) at the nodes; between corners the least one of the nodes of the facets.

    A node that faces nothing has -inf, and is not the least one beside others.
    """
    found, corners = away.copy(), side.kind.corners
    least = np.where(np.isfinite(away), away, np.inf)[side.facets].min(axis=1)
    between = side.facets[:, corners:]
    np.minimum.at(found, between, np.broadcast_to(least[:, None], between.shape))
    return found


def _distances(
    points: FloatArray, of: Side, at: IntArray, side: Side
) -> tuple[FloatArray, FloatArray, IntArray]:
    """The distances (k,) of points (k, d) to a side, the sagittae (k,) there, and the facets (k,).

    The points are those of facets ``at`` (k,) of the side ``of``.  The sagitta is inf, so that
    nothing counts, where a point faces no facet of another body.
    """
    numbers = np.arange(side.facets[:, : side.kind.corners].size)
    pieces = side.kind.split(numbers.reshape(-1, side.kind.corners))
    corners = side.corners.reshape(-1, points.shape[1])[pieces]
    facet = np.repeat(np.arange(len(side.facets)), len(side.kind.simplices))
    among = of.bodies is not None and side.bodies is not None
    count = min(_NEAREST_OF_ALL if among else _NEAREST, len(corners))
    near = cKDTree(corners.mean(axis=1)).query(points, k=count)[1].reshape(len(points), count)
    edges = corners[near][:, :, 1:] - corners[near][:, :, :1]
    away = points[:, None] - corners[near][:, :, 0]
    gram = edges @ edges.transpose(0, 1, 3, 2)
    place = np.linalg.solve(gram, np.einsum("kfed,kfd->kfe", edges, away)[..., None])[..., 0]
    # The nearest point of a facet, with coordinates that are cut off at its edges.
    place = np.clip(place, 0.0, 1.0)
    place = place / np.maximum(place.sum(axis=2, keepdims=True), 1.0)
    way = away - np.einsum("kfe,kfed->kfd", place, edges)
    size = np.linalg.norm(way, axis=2)
    if of.bodies is not None and side.bodies is not None:
        size[side.bodies[facet[near]] == of.bodies[at][:, None]] = np.inf
    best = np.argmin(size, axis=1)
    every = np.arange(len(points))
    nearest, length = facet[near[every, best]], size[every, best]
    along = np.sum(way[every, best] * side.outward[nearest], axis=1)
    extent = np.linalg.norm(edges[every, best], axis=2).max(axis=1)
    faces = np.isfinite(length) & (np.abs(along) >= _ALONG * length) & (length < extent)
    sagitta = np.where(faces, _sagittae(side)[nearest], np.inf)
    return np.sign(along) * length, sagitta, nearest


def _lattice(side: Side) -> tuple[FloatArray, IntArray]:
    """Points (q, d) of all facets, corners included, and the facet (q,) of each."""
    steps = np.linspace(0.0, 1.0, _DIVISIONS + 1)
    grid = np.stack(np.meshgrid(*[steps] * side.kind.dim), axis=-1).reshape(-1, side.kind.dim)
    if side.kind.is_simplex:
        grid = grid[grid.sum(axis=1) <= 1.0 + 1e-9]
    points = np.einsum("qc,mcd->mqd", side.kind.basis(grid), side.corners)
    return points.reshape(-1, points.shape[2]), np.repeat(np.arange(len(points)), len(grid))


def _sagittae(side: Side) -> FloatArray:
    """The largest heights (m,) of a round side above its facets.

    In 2D the angle is the smaller one of those to both neighbours: a flat facet beside a fillet has
    no sagitta.  In 3D it is the angle between the averaged normals, doubled, as these turn by half
    of it at the rim.
    """
    if side.kind.dim == 1:
        return np.asarray(side.sizes() * _turns(side) / 8.0)
    normals = side.nodal_normals()[side.facets[:, : side.kind.corners]]
    heights = np.zeros(len(side.facets))
    for i, j in combinations(range(side.kind.corners), 2):
        along = side.corners[:, j] - side.corners[:, i]
        turn = np.sum((normals[:, j] - normals[:, i]) * along, axis=1)
        heights = np.maximum(heights, 2.0 * np.abs(turn) / 8.0)
    return heights


def _turns(side: Side) -> FloatArray:
    """(m,) the smaller angle of each segment to its two neighbours, 0 without one."""
    at = side.facets[:, :2].reshape(-1)
    order = np.argsort(at, kind="stable")
    pairs = np.flatnonzero(np.diff(at[order]) == 0)
    one, other = order[pairs] // 2, order[pairs + 1] // 2
    cosine = np.sum(side.outward[one] * side.outward[other], axis=1)
    turns = np.full(2 * len(side.facets), np.inf)
    angles = np.arccos(np.clip(cosine, -1.0, 1.0))
    turns[order[pairs]], turns[order[pairs + 1]] = angles, angles
    least = turns.reshape(-1, 2).min(axis=1)
    return np.where(np.isfinite(least), least, 0.0)
