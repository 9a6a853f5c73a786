"""Which points of side 1 face which points of side 2, from their geometry alone.

The jump of a field u at the node i of side 1 is

    [u]_i = sum_j l_ij c1_j - sum_k m_ik u2_k,
    l_ij = int psi_i b_j / w_i,   m_ik = int psi_i (phi2_k o chi) / w_i,   w_i = int psi_i,

with the coefficients c1 of u on side 1 in Bernstein's basis b, the nodal functions phi2 of side 2,
and the dual basis psi of side 1, ``int psi_i b_j = delta_ij int b_j`` (Wohlmuth,
doi:10.1137/S0036142999350929), so that l is the identity.  For affine functions b and phi are hat
functions and c1 the values at the nodes; for quadratic ones c1 are the control values
(:class:`~contact_locking.fem.spaces.Trace`).  chi(x) is the point of side 2 that the ray from x
along the outward normal n of the facet meets, at the height ``h(x) = (chi(x) - x) . n``, which is
negative where the sides overlap.  The b_i have the sum 1, and so have the psi_i: a constant
pressure on side 1 is one on side 2.  All integrals are over the part of side 1 that side 2 covers,
and the dual basis is that of this part (Popp et al., doi:10.1016/j.cma.2010.11.004).  The facets of
side 2 are projected into the plane of each facet of side 1 and cut there, so that integrals of
polynomials are exact.  The functions of quadrilaterals that are no parallelograms are no
polynomials: their integrals have errors of some 1e-11, and larger ones where the Jacobians at two
corners have a quotient below 1/6.

A node of which side 2 covers only a sliver has no condition: its pressure would be a force over
next to nothing.  Its function b is added to that of the nearest node with a condition, and the dual
basis is that of these sums.  Constant pressures still are the same on both sides.

The gap of a node is the distance of the point ``sum_j l_ij x_j``, the node itself without slivers,
to side 2 along the contact normal, which is the mean of the normals of both sides.  An edge of a
body has no normal of its own: there it is that of side 2, or of the facet of side 2, as the share
of the pressure along a tilted normal would replace friction.  Where the ray misses side 2, the
facet that it passes nearest to is continued.

A quadrilateral of side 1 whose corners are not in one plane is projected into its mean plane, as
are those of side 2 that it faces.  Integrals are those over the projection, whose area is too small
by a share of the order of the square of the height of a corner over the length of the facet.

The facets are chords of curved sides.  Beside the chord from 1 to 2 of side 2 the side is
``|x_2 - x_1| (nu_2 - nu_1) . t/2`` times the product of both hat functions farther out, with the
normals nu at the nodes and the tangent t, if it bends by at least half as much beside the chord:
where a flat side goes over into a fillet it has no bulge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.contact.overlap import (
    EDGES,
    axes_across,
    bernstein,
    boxes_meet,
    degree_of,
    dual_basis,
    functions,
    nodal,
    overlaps,
    quadrature,
    summed,
)
from contact_locking.mesh.data import CellKind, corner_normals, facet_normals, unit_normals

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

# Two facets face each other if the cosine of the angle between their normals is below this: a facet
# that is seen at a grazing angle is the flank of a body.
_FACING = -0.3
# A ray meets side 2 within this multiple of the least distance, by the angle above, or not at all.
_REACH = 3.3
# A node has a condition if more than these shares of the integral of its function are over the
# covered part, in one of its facets and in all of them.
_SLIVER, _SLIVER_OF_ALL = 0.6, 0.35
# A facet is covered if this share of it is: a lesser share is rounding, or the rim of side 2.
_COVERED = 1e-3
# A facet may be covered by this share more than once: rounding.
_TWICE = 1e-6
# Points nearer to the axis than this share of the extent are on it.
_ON_AXIS = 1e-9
# A ray through a common corner of facets meets them up to this share of their length.
_INSIDE = 1e-9
# The plane of a facet is continued where the cosine of its normal and the ray is below this.
_STEEP = -0.7
# The cosine of 15 degrees.
_SMOOTH = 0.966
# A side is round where its curvature changes by no more than this factor from edge to edge.
_ALIKE = 0.4
# Beside a point of a round side an edge turns by this share of the angle to a facet there, or more.
_ROUND = 0.5
# The cosine of 37 degrees, by which the edges of a mesh of triangles turn from one to the next.
_GOES_ON = 0.8


@dataclass(frozen=True)
class Side:
    """One side of an interface: its facets, whose ``outward`` unit normals point to the other.

    ``points`` (k, d) are its nodes, ``kind`` is that of its facets, ``facets`` (m, n) are the nodes
    of the facets as numbers of points, and ``outward`` is (m, d).  The corners of a facet are
    first; behind them are the midpoints of its edges for quadratic functions, in the order of
    DOLFINx.  ``bodies`` (m,) are the numbers of the bodies of the facets where several bodies touch
    each other.  If the side ``revolves``, about x = 0, integrals have the factor 2 pi x.  ``rest``
    (k, d) are the nodes of a side that has moved: tractions are forces over the area at rest.
    """

    points: FloatArray
    kind: CellKind
    facets: IntArray
    outward: FloatArray
    bodies: IntArray | None = None
    revolves: bool = False
    rest: FloatArray | None = None

    @property
    def corners(self) -> FloatArray:
        """The corners (m, c, d) of the facets."""
        return self.points[self.facets[:, : self.kind.corners]]

    @property
    def is_quadratic(self) -> bool:
        """Whether the midpoints of edges are nodes, too."""
        return self.facets.shape[1] > self.kind.corners

    def moved(self, by: FloatArray) -> Side:
        """The side after its points have moved by (k, d)."""
        return self._at(self.points + by, self.points)

    @property
    def at_rest(self) -> Side:
        """The side where it was before it moved."""
        return self if self.rest is None else self._at(self.rest, None)

    def _at(self, points: FloatArray, rest: FloatArray | None) -> Side:
        turn = np.sum(unit_normals(self.corners) * self.outward, axis=1)
        side = replace(self, points=points, rest=rest)
        return replace(side, outward=np.sign(turn)[:, None] * unit_normals(side.corners))

    def nodal_normals(self) -> FloatArray:
        """The unit normals (k, d) at the points, averaged over the facets around each."""
        normals = np.zeros_like(self.points)
        for corner in self.facets.T:
            np.add.at(normals, corner, self.sizes()[:, None] * self.outward)
        if self.revolves:
            # The facets around a point of the axis are those of a whole circle.
            normals[np.abs(self.points[:, 0]) <= _ON_AXIS * np.ptp(self.points[:, 0]), 0] = 0.0
        return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])

    def sizes(self) -> FloatArray:
        """The lengths (m,) or areas of the facets."""
        return np.asarray(np.linalg.norm(facet_normals(self.corners), axis=1))


@dataclass(frozen=True)
class Pairing:
    """How side 2 faces the k nodes of side 1.

    ``near`` (k, k) are the l_ij and ``shares`` (k, k2) the m_ik, whose rows have the sum 1.
    ``gap`` (k,) is the distance, for quadratic functions its control values, ``normals`` (k, d) are
    the contact normals, and ``weights`` (k,) the w_i.  ``faces`` (k,) marks the nodes with a
    condition; the others have zeros.  ``twice`` is a point (d,) whose ray meets side 2 several
    times, None without such a point.
    """

    near: csr_matrix
    shares: csr_matrix
    gap: FloatArray
    normals: FloatArray
    weights: FloatArray
    faces: BoolArray
    twice: FloatArray | None


def pair(first: Side, second: Side) -> Pairing:
    """The pairing of side 1, ``first``, with side 2, ``second``.

    If both have the same facets, of several bodies, each facet is paired with the nearest other
    body if this has the larger number: of two bodies one is side 1.
    """
    from scipy.sparse import csr_matrix

    frames, middles = axes_across(first.outward), first.corners.mean(axis=1)[:, None]
    facet, facing = _candidates(first, second)
    if first.bodies is not None and second.bodies is not None:
        own_body, other_body = first.bodies[facet], second.bodies[facing]
        away = second.corners.mean(axis=1)[facing] - first.corners.mean(axis=1)[facet]
        distance = np.where(own_body != other_body, np.linalg.norm(away, axis=1), np.inf)
        # The last entry for a facet is the nearest other body.
        order = np.argsort(-distance, kind="stable")
        nearest = np.full(len(first.facets), -1)
        nearest[facet[order]] = other_body[order]
        kept = (other_body == nearest[facet]) & (own_body < other_body)
        facet, facing = facet[kept], facing[kept]
    away = second.corners[facing] - middles[facet]
    flat = np.einsum("pcd,ptd->pct", away, frames[facet])
    plane = np.einsum("mcd,mtd->mct", first.corners - middles, frames)
    meet = boxes_meet(plane[facet], flat)
    facet, facing, flat = facet[meet], facing[meet], flat[meet]
    number, pieces = overlaps(plane[facet], flat, first.kind)
    degree = max(degree_of(side.kind, side.corners) for side in (first, second))
    places, weights = quadrature(pieces, degree)
    at_first = functions(first.kind, plane[facet[number]], places)
    at_second = functions(second.kind, flat[number], places)
    covered = summed(facet[number], len(first.facets), weights[:, :, None]).sum(axis=(1, 2))
    weights = weights * _density(first, facet[number], at_first)
    of_first = bernstein(at_first) if first.is_quadratic else at_first
    of_second = nodal(at_second) if second.is_quadratic else at_second

    # Sums over the pieces of each pair, then over the pairs of each facet.
    mixed = summed(number, len(facet), np.einsum("qn,qni,qnk->qik", weights, of_first, of_second))
    mass = np.einsum("qn,qni,qnj->qij", weights, of_first, of_first)
    mass = summed(facet[number], len(first.facets), mass)
    sizes = first.sizes()
    is_covered = covered > _COVERED * sizes
    mass[~is_covered] = 0.0
    target, faces = _targets(first, mass.sum(axis=2), _integrals(first, plane))
    nodes = target[first.facets]
    # The functions of nodes with one target are added to that of the first of them in the facet.
    same = nodes[:, :, None] == nodes[:, None, :]
    is_first = np.argmax(same, axis=2)[:, None, :] == np.arange(nodes.shape[1])[None, :, None]
    joined = is_first.astype(float)
    joined_mass = joined @ mass
    dual = np.zeros_like(mass)
    dual[is_covered] = (
        dual_basis((joined_mass @ joined.transpose(0, 2, 1))[is_covered]) @ joined[is_covered]
    )

    count = len(first.points)
    weight = np.bincount(nodes.reshape(-1), joined_mass.sum(axis=2).reshape(-1), count)
    total = np.where(faces, weight, 1.0)

    def rows(at: IntArray, entries: FloatArray, columns: IntArray, size: int) -> csr_matrix:
        """The matrix (k, size) of entries (p, n, c) at facets ``at`` and columns (p, c)."""
        where = np.repeat(nodes[at], columns.shape[1], axis=1).reshape(-1)
        across = np.tile(columns, (1, nodes.shape[1])).reshape(-1)
        values = entries.reshape(-1) / total[where]
        matrix = csr_matrix((values, (where, across)), shape=(count, size))
        matrix.eliminate_zeros()
        return matrix

    near = rows(np.arange(len(first.facets)), dual @ mass, first.facets, count)
    shares = rows(facet, dual[facet] @ mixed, second.facets[facing], len(second.points))
    gap, normals = _distances(first, second, near @ first.points, nodes[facet], facing)
    if first.is_quadratic:
        gap = _control_values(first, gap, faces)
    several = np.flatnonzero(covered > (1.0 + _TWICE) * sizes)
    twice = first.corners[several[0]].mean(axis=0) if len(several) else None
    return Pairing(
        near, shares, np.where(faces, gap, 0.0), normals, np.where(faces, weight, 0.0), faces, twice
    )


def _integrals(side: Side, plane: FloatArray) -> FloatArray:
    """(m, n) the integrals of the functions of the nodes over whole facets (m, c, d - 1)."""
    number, pieces = overlaps(plane, plane, side.kind)
    places, weights = quadrature(pieces, degree_of(side.kind, side.corners))
    values = functions(side.kind, plane[number], places)
    weights = weights * _density(side, number, values)
    of_nodes = bernstein(values) if side.is_quadratic else values
    each = np.einsum("qn,qni->qi", weights, of_nodes)
    return summed(number, len(plane), each[:, :, None])[:, :, 0]


def _density(side: Side, facet: IntArray, values: FloatArray) -> FloatArray:
    """(q, n) the area at rest over that of plane facets (q,), at points with values (q, n, c)."""
    at_rest = side.at_rest
    ratio = (at_rest.sizes() / side.sizes())[facet, None]
    if side.revolves:
        ratio = (
            ratio * 2.0 * math.pi * np.einsum("qni,qi->qn", values, at_rest.corners[facet, :, 0])
        )
    return np.asarray(ratio)


def _targets(side: Side, covered: FloatArray, whole: FloatArray) -> tuple[IntArray, BoolArray]:
    """(k,) the node whose condition takes the function of each node, and which nodes have one.

    ``covered`` and ``whole`` (m, n) are the integrals of the functions over covered parts of
    facets, and over facets.  A node without a condition has the target of its nearest neighbour
    that has one, in a covered facet.  In a covered part of side 1 that is smaller than its facets
    the node that is covered most has one.
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    count, width = len(side.points), side.facets.shape[1]
    share = np.zeros(count)
    np.maximum.at(share, side.facets, covered / whole)
    at, size = side.facets.reshape(-1), whole.reshape(-1)
    integral = np.bincount(at, covered.reshape(-1), count)
    faces = (share > _SLIVER) & (integral > _SLIVER_OF_ALL * np.bincount(at, size, count))
    is_covered = covered.sum(axis=1) > 0.0
    within = side.facets[is_covered]
    ends = [within[:, each].reshape(-1) for each in np.indices([width] * 2).reshape(2, -1)]
    start, end = ends
    piece = connected_components(csr_matrix((np.ones(len(start)), (start, end)), (count, count)))[1]
    order = np.lexsort((*side.points.T, integral))
    most = np.full(count, -1)
    most[piece[order]] = order
    is_alone = ~np.isin(piece, piece[faces]) & (integral > 0.0)
    faces[most[piece[is_alone]]] = True
    target = np.where(faces, np.arange(count), -1)
    lengths = np.linalg.norm(side.points[start] - side.points[end], axis=1)
    # The nearest comes last; of several equally near ones, that whose coordinates are the largest.
    rounded = np.round(lengths / lengths.max(initial=np.finfo(float).tiny), 9)
    order = np.lexsort((*side.points[end].T, -rounded))
    start, end = start[order], end[order]
    while True:
        step = (target[start] < 0) & (target[end] >= 0)
        if not step.any():
            return np.where(target < 0, np.arange(count), target), faces
        target[start[step]] = target[end[step]]


def _distances(
    first: Side, second: Side, points: FloatArray, nodes: IntArray, facing: IntArray
) -> tuple[FloatArray, FloatArray]:
    """The distances (k,) of points (k, d) of side 1 along the contact normals, and these (k, d).

    ``nodes`` (p, n) are those of facets of side 1, ``facing`` (p,) the facets of side 2 they face.
    """
    pairs = np.column_stack([nodes.reshape(-1), np.repeat(facing, nodes.shape[1])])
    node, facing = np.unique(pairs, axis=0).T
    # Between corners quadratic sides have moved by themselves, off chords that they have at rest.
    bulge, bulge_of_first = (_bulge(x.at_rest if x.is_quadratic else x) for x in (second, first))
    of_side, farther_out, count = first.nodal_normals(), np.zeros(len(points)), first.kind.corners
    for number, (start, end) in enumerate(EDGES[count] if first.is_quadratic else ()):
        farther_out[first.facets[:, count + number]] = 0.25 * bulge_of_first[:, start, end]
    # The normals (m, c, d) at the corners of side 2: the averaged ones, but at edges of a body.
    corners = second.facets[:, : second.kind.corners]
    of_other, is_edge = second.nodal_normals()[corners], _at_edge(second)[corners]
    is_edge |= np.sum(of_other * second.outward[:, None], axis=2) < _SMOOTH
    of_other = np.where(is_edge[:, :, None], second.outward[:, None], of_other)
    normals, gap, at_edge = of_side.copy(), np.zeros(len(points)), _at_edge(first)
    for _ in range(2):
        along, away = normals[node], second.points[second.facets[facing]] - points[node][:, None]
        every_height = np.einsum("pnd,pd->pn", away, along)
        away, heights = (values[:, : second.kind.corners] for values in (away, every_height))
        flat = np.einsum("pcd,ptd->pct", away, axes_across(along))
        with np.errstate(all="ignore"):
            basis = functions(second.kind, flat, np.zeros((len(flat), 1, flat.shape[2])))[:, 0]
        # A point far outside of a quadrilateral may have no coordinates in it.
        basis = np.where(
            np.isfinite(basis).all(axis=1, keepdims=True), basis, np.eye(basis.shape[1])[0]
        )
        shape = nodal(basis) if second.is_quadratic else basis
        height = np.einsum("pn,pn->p", shape, every_height) - farther_out[node]
        height -= np.einsum("pij,pi,pj->p", bulge[facing], basis, basis)
        outside = basis.min(axis=1) < -_INSIDE
        nearest = np.maximum(basis, 0.0)
        nearest /= nearest.sum(axis=1)[:, None]
        # A ray that misses a facet is judged by how far.  It meets the plane of the facet, or the
        # height of its edge where the facet is seen at a grazing angle.
        aside = np.linalg.norm(np.einsum("pc,pct->pt", nearest, flat), axis=1)
        slope = np.sum(second.outward[facing] * along, axis=1)
        plane = np.sum(second.outward[facing] * away.mean(axis=1), axis=1)
        beside = plane / np.where(slope < _STEEP, slope, -1.0)
        beside = np.where(slope < _STEEP, beside, np.einsum("pc,pc->p", nearest, heights))
        height = np.where(outside, beside, height)
        order = np.lexsort((np.where(outside, aside, np.abs(height)), outside, node))
        node_of, start = np.unique(node[order], return_index=True)
        best = order[start]
        gap[node_of] = height[best]
        facing_normal = np.einsum("pc,pcd->pd", nearest[best], of_other[facing[best]])
        facing_normal /= np.linalg.norm(facing_normal, axis=1)[:, None]
        mean = np.where(at_edge[node_of, None], 0.0, of_side[node_of]) - facing_normal
        normals[node_of] = mean / np.linalg.norm(mean, axis=1)[:, None]
    return gap, normals


def _at_edge(side: Side) -> BoolArray:
    """(k,) the points at edges of a body, where facets turn and the side is not round beside.

    These are the edges at rest, as strains make none.
    """
    side = side.at_rest
    edges, _, lengths, curvature = _curved(side)
    turn, off = np.zeros(len(side.points)), np.zeros(len(side.points))
    np.maximum.at(turn, edges, np.abs(lengths * curvature)[:, None])
    cosine = np.sum(side.nodal_normals()[side.facets] * side.outward[:, None], axis=2)
    np.maximum.at(off, side.facets, np.sqrt(np.maximum(1.0 - cosine**2, 0.0)))
    return np.asarray(turn < _ROUND * off)


def _control_values(side: Side, gap: FloatArray, faces: BoolArray) -> FloatArray:
    """The control values (k,) of nodal values, between the least and the largest of an edge.

    The control value of a gap that has a kink would be far off.
    """
    values, count = gap.copy(), side.kind.corners
    for number, edge in enumerate(EDGES[count]):
        ends, middle = side.facets[:, edge], side.facets[:, count + number]
        some = np.column_stack([gap[ends], gap[middle]])
        control = np.clip(
            2.0 * some[:, 2] - 0.5 * (some[:, 0] + some[:, 1]), some.min(axis=1), some.max(axis=1)
        )
        known = faces[ends].all(axis=1)
        values[middle[known]] = control[known]
    return values


def _candidates(first: Side, second: Side) -> tuple[IntArray, IntArray]:
    """The pairs (p,) of facets of both sides that may face each other."""
    from scipy.spatial import cKDTree

    # Balls around the facets.
    middles = [side.corners.mean(axis=1) for side in (first, second)]
    around = [
        np.linalg.norm(side.corners - middle[:, None], axis=2).max(axis=1, initial=0.0)
        for side, middle in zip((first, second), middles, strict=True)
    ]
    tree = cKDTree(middles[1])
    largest = around[1].max(initial=0.0)
    distance = np.maximum(tree.query(middles[0])[0] - largest, 0.0)
    reach = _REACH * distance + around[0] + 2.0 * largest
    neighbours = tree.query_ball_point(middles[0], reach, return_sorted=True)
    facet = np.repeat(np.arange(len(neighbours)), [len(some) for some in neighbours])
    facing = np.concatenate([np.empty(0, np.int64), *(np.asarray(x, np.int64) for x in neighbours)])
    away = middles[1][facing] - middles[0][facet]
    outward = first.outward[facet]
    aside = np.sum(away**2, axis=1) - np.sum(away * outward, axis=1) ** 2
    near = aside <= (around[0][facet] + around[1][facing]) ** 2
    kept = near & (np.sum(outward * second.outward[facing], axis=1) < _FACING)
    return facet[kept], facing[kept]


def _round_normals(side: Side) -> FloatArray:
    """The unit normals (k, d) at the points, exact on a circle and on a sphere."""
    normals, corners = np.zeros_like(side.points), side.facets.T
    _, weights = corner_normals(side.kind, side.corners)
    for number in range(side.kind.corners):
        np.add.at(normals, corners[number], weights[:, [number]] * side.outward)
    sizes = np.linalg.norm(normals, axis=1)
    return np.asarray(normals / np.where(sizes > 0.0, sizes, 1.0)[:, None])


def _bulge(side: Side) -> FloatArray:
    """The coefficients (m, c, c) of products of two functions, by which a side is farther out.

    They have nonzero entries above the diagonal.  At a corner of the body, whose normal is more
    than 15 degrees off that of the facet, the side is straight.
    """
    count = side.kind.corners
    edges, number, lengths, curvature = _curved(side)
    off = np.einsum("meqi,mi->meq", _round_normals(side)[edges[number]], side.outward).min(axis=2)
    bulges = np.where(off < _SMOOTH, 0.0, (0.5 * lengths**2 * curvature)[number])
    pairs = np.array(EDGES[count])
    products = np.zeros((len(side.facets), count, count))
    products[:, pairs[:, 0], pairs[:, 1]] = bulges
    if count == 4:
        # The product is that of both diagonals, whose coefficients have the sum of all edges.
        products[:, 0, 3] = bulges.sum(axis=1)
    return products


def _curved(side: Side) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """The edges (e, 2), their numbers (m, c) in facets, lengths and curvatures (e,) of a side.

    The curvature along an edge is the difference of the normals at its ends over its length.  A
    side is round along an edge if the edges that continue it bend at least half as much; at the
    rim, where the normals are those of one facet, the curvature is that of the edge that continues
    it on the other side.  It is 0 where the side is not round.
    """
    corners = side.facets[:, : side.kind.corners]
    pairs = np.array(EDGES[side.kind.corners])
    edges, number = np.unique(
        np.sort(corners[:, pairs].reshape(-1, 2), axis=1), axis=0, return_inverse=True
    )
    normals, along = _round_normals(side), np.diff(side.points[edges], axis=1)[:, 0]
    lengths = np.linalg.norm(along, axis=1)
    along = along / lengths[:, None]
    turn = np.einsum("ei,ei->e", np.diff(normals[edges], axis=1)[:, 0], along)
    curvature = turn / lengths
    beyond = _continued(edges, along)
    nearby = np.where(beyond >= 0, curvature[beyond], 0.0)
    is_rim = (beyond < 0).sum(axis=1) == 1
    # Beside the rim the normals turn half as much as the side does.
    rim, mine = nearby.sum(axis=1), np.where(is_rim, 2.0, 1.0) * curvature
    size, sign = np.abs(mine), np.sign(mine)[:, None]
    is_round = np.all(sign * nearby >= _ALIKE * size[:, None], axis=1)
    is_round |= is_rim & (sign[:, 0] * rim >= _ALIKE * size) & (_ALIKE * np.abs(rim) <= size)
    curvature = np.where(is_round, np.where(is_rim, rim, curvature), 0.0)
    return edges, number.reshape(-1, len(pairs)), lengths, curvature


def _continued(edges: IntArray, along: FloatArray) -> IntArray:
    """(e, 2) the edges that go on at the ends of edges (e, 2) along (e, d), -1 at the rim."""
    from scipy.sparse import csr_matrix

    count = 2 * len(edges)
    outgoing = np.stack([along, -along], axis=1).reshape(count, -1)
    at = csr_matrix((np.ones(count), (np.arange(count), edges.reshape(-1))))
    start, end = (at @ at.T).nonzero()
    cosine = np.sum(outgoing[start] * outgoing[end], axis=1)
    kept = cosine < -_GOES_ON
    # The straightest comes last.
    order = np.argsort(-cosine[kept], kind="stable")
    following = np.full(count, -1)
    following[start[kept][order]] = end[kept][order] // 2
    return following.reshape(-1, 2)
