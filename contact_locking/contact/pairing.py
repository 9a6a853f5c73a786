"""Which points of one side face which points of another, by their geometry alone.

From a point x of side 1 the ray along the outward normal n of its facet meets side 2 at chi(x), at
the height ``h(x) = (chi(x) - x) . n``, which is negative where the sides overlap.  The jump of a
field u at the node i of side 1 is

    [u]_i = c1_i - sum_k m_ik u2_k,   m_ik = int psi_i (phi2_k o chi) / int b_i,

with the coefficients c1 of u on side 1 in Bernstein's basis b, the nodal functions phi2 of side 2,
and the dual basis psi of side 1, ``int psi_i b_j = delta_ij int b_j`` (Wohlmuth,
doi:10.1137/S0036142999350929).  For affine functions b and phi are hat functions and c1 the values
at the nodes; for quadratic ones c1 are the control values (:class:`~contact_locking.fem.trace.
Trace`).  The b_i have the sum 1, and so have the psi_i: a constant pressure on side 1 is one on
side 2.  All integrals are over the part of side 1 that side 2 covers, and the dual basis is that
of this part (Popp et al., doi:10.1016/j.cma.2010.11.004).  The facets of side 2 are projected into
the plane of each facet of side 1 and cut there, so that integrals of polynomials are exact.  The
functions of quadrilaterals that are no parallelograms are no polynomials: their integrals have
errors of some 1e-11, and larger ones where the Jacobians at two corners have a quotient below 1/6.

A quadrilateral of side 1 whose corners are not in one plane is projected into its mean plane, as
are those of side 2 that it faces.  The gap has the heights of both over this plane.  Integrals are
those over the projection, whose area is too small by a share of the order of the square of the
height of a corner over the length of the facet.

The facets are chords of curved sides, and so the distance between two meshes of one circle is not
zero.  The gap is therefore that between the curved sides which the averaged normals at the nodes
describe: beside the chord from 1 to 2 a side is ``|x_2 - x_1| (nu_2 - nu_1) . t/2`` times the
product of both hat functions farther out, with the tangent t.

A point of a plane quadrilateral is ``x = a + b s + c t + d s t`` with s and t from 0 to 1.  With
the cross product, y = x - a, and the Jacobian J there,

    s = 2 (y x c)/(b x c - y x d + J),   t = 2 (b x y)/(b x c + y x d + J),
    J^2 = (b x c - y x d)^2 + 4 (b x d)(y x c),

whose denominators are twice the Jacobian at the sides s = 0 and t = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import basix
import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.mesh.cell_kind import CellKind, facet_normals, unit_normals

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

# Two facets face each other if the cosine of the angle between their normals is below this: a facet
# that is seen at a grazing angle is the flank of a body.
_FACING = -0.3
# A ray meets side 2 within this multiple of the least distance, by the angle above, or not at all.
_REACH = 3.3
# A facet is covered if this share of it is: a lesser share is rounding, or the rim of side 2.
_COVERED = 1e-3
# A facet may be covered by this share more than once: rounding.
_TWICE = 1e-6
# Points nearer to the axis than this share of the extent are on it.
_ON_AXIS = 1e-9
# By this factor the integrals of functions over quadrilaterals become more accurate than by a rule
# that is exact for parallelograms, which these are up to a factor of rounding.  The last factor is
# that of quadrilaterals with Jacobians of 1 and 1/6; more bent ones have the rule of these.
_SMALL, _PARALLEL, _MOST_BENT = 1e-12, 1e-16, 0.42
# The cosine of 15 degrees.
_SMOOTH = 0.966

# The edges of facets, as their corners, by the number of corners, in the order of DOLFINx.
_EDGES = {2: [(0, 1)], 3: [(1, 2), (0, 2), (0, 1)], 4: [(0, 1), (0, 2), (1, 3), (2, 3)]}


@dataclass(frozen=True)
class Side:
    """One side of an interface: its facets, whose ``outward`` unit normals point to the other.

    ``points`` (k, d) are its nodes, ``kind`` is that of its facets, ``facets`` (m, n) are the nodes
    of the facets as numbers of points, and ``outward`` is (m, d).  The corners of a facet are
    first; behind them are the midpoints of its edges for quadratic functions, in the order of
    DOLFINx, and the middle of a quadrilateral.  ``bodies`` (m,) are the numbers of the bodies of
    the facets where several bodies touch each other.  If the side ``revolves``, about x = 0,
    integrals have the factor 2 pi x.
    """

    points: FloatArray
    kind: CellKind
    facets: IntArray
    outward: FloatArray
    bodies: IntArray | None = None
    revolves: bool = False

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
        turn = np.sum(unit_normals(self.corners) * self.outward, axis=1)
        there = replace(self, points=self.points + by)
        outward = np.sign(turn)[:, None] * unit_normals(there.corners)
        return replace(there, outward=outward)

    def nodal_normals(self) -> FloatArray:
        """The unit normals (k, d) at the points, averaged over the facets around each."""
        found = np.zeros_like(self.points)
        for corner in self.facets.T:
            np.add.at(found, corner, self.sizes()[:, None] * self.outward)
        if self.revolves:
            # The facets around a point of the axis are those of a whole circle.
            found[np.abs(self.points[:, 0]) <= _ON_AXIS * np.ptp(self.points[:, 0]), 0] = 0.0
        return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])

    def sizes(self) -> FloatArray:
        """The lengths (m,) or areas of the facets."""
        return np.asarray(np.linalg.norm(facet_normals(self.corners), axis=1))


@dataclass(frozen=True)
class Pairing:
    """How side 2 faces the k nodes of side 1.

    ``shares`` (k, k2) are the m_ik, whose rows have the sum 1.  ``gap`` (k,) is
    ``int psi_i h / int b_i``, and ``weights`` (k,) are ``int b_i``.  ``faces`` (k,) marks the
    nodes that face side 2; the others have zeros.  ``twice`` is a point (d,) whose ray meets side 2
    several times, None without such a point.
    """

    shares: csr_matrix
    gap: FloatArray
    weights: FloatArray
    faces: BoolArray
    twice: FloatArray | None


def pair(one: Side, other: Side) -> Pairing:
    """The pairing of side 1, ``one``, with side 2.

    If both have the same facets, of several bodies, each facet is paired with the nearest other
    body if this has the larger number: of two bodies one is side 1.
    """
    from scipy.sparse import csr_matrix

    frames, middles = _tangents(one), one.corners.mean(axis=1)[:, None]
    facet, facing = _candidates(one, other)
    if one.bodies is not None and other.bodies is not None:
        first_body, second = one.bodies[facet], other.bodies[facing]
        kept = _of_the_nearest(one, other, facet, facing, first_body != second)
        kept &= first_body < second
        facet, facing = facet[kept], facing[kept]
    away = other.corners[facing] - middles[facet]
    flat = np.einsum("pcd,ptd->pct", away, frames[facet])
    heights = np.einsum("pcd,pd->pc", away, one.outward[facet])
    own = np.einsum("mcd,mtd->mct", one.corners - middles, frames)
    own_heights = np.einsum("mcd,md->mc", one.corners - middles, one.outward)
    meet = _boxes_meet(own[facet], flat)
    facet, facing, flat, heights = facet[meet], facing[meet], flat[meet], heights[meet]
    number, pieces = _overlaps(own[facet], flat, one.kind)
    places, weights = _quadrature(pieces, max(_degree(one), _degree(other)))
    at_one = _functions(one.kind, own[facet[number]], places)
    at_other = _functions(other.kind, flat[number], places)
    covered = _summed(facet[number], len(one.facets), weights[:, :, None]).sum(axis=(1, 2))
    if one.revolves:
        radii = np.einsum("qni,qi->qn", at_one, one.corners[facet[number], :, 0])
        weights = 2.0 * math.pi * radii * weights
    of_one = _bernstein(at_one) if one.is_quadratic else at_one
    of_other = _nodal(at_other) if other.is_quadratic else at_other

    # Sums over the pieces of each pair, then over the pairs of each facet.
    mixed = _summed(number, len(facet), np.einsum("qn,qni,qnk->qik", weights, of_one, of_other))
    bulge = _bulge(one)[facet[number]], _bulge(other)[facing[number]]
    away = np.einsum("qnk,qk->qn", at_other, heights[number])
    away -= np.einsum("qnk,qk->qn", at_one, own_heights[facet[number]])
    for part, at in zip(bulge, (at_one, at_other), strict=True):
        away -= np.einsum("qij,qni,qnj->qn", part, at, at)
    height = np.einsum("qn,qni,qn->qi", weights, of_one, away)
    height = _summed(number, len(facet), height[:, :, None])[:, :, 0]
    mass = np.einsum("qn,qni,qnj->qij", weights, of_one, of_one)
    mass = _summed(facet[number], len(one.facets), mass)
    integral = mass.sum(axis=2)
    sizes = one.sizes()
    is_covered = covered > _COVERED * sizes
    dual = np.zeros_like(mass)
    dual[is_covered] = _dual_basis(mass[is_covered])
    mixed, height = dual[facet] @ mixed, np.einsum("pij,pj->pi", dual[facet], height)

    count = len(one.points)
    nodes = one.facets[facet]
    every: FloatArray = np.bincount(
        one.facets[is_covered].reshape(-1), integral[is_covered].reshape(-1), count
    ).astype(float)
    faces = every > 0.0
    total = np.where(faces, every, 1.0)
    rows = np.repeat(nodes, other.facets.shape[1], axis=1).reshape(-1)
    columns = np.tile(other.facets[facing], (1, nodes.shape[1])).reshape(-1)
    entries = mixed.reshape(-1) / total[rows]
    shares = csr_matrix((entries, (rows, columns)), shape=(count, len(other.points)))
    shares.eliminate_zeros()
    gap = np.bincount(nodes.reshape(-1), height.reshape(-1), count) / total
    several = np.flatnonzero(covered > (1.0 + _TWICE) * sizes)
    twice = one.corners[several[0]].mean(axis=0) if len(several) else None
    return Pairing(shares, gap, every, faces, twice)


def _tangents(side: Side) -> FloatArray:
    """Orthonormal tangents (m, d - 1, d) of the facets, or of their mean planes."""
    along = side.corners[:, 1] - side.corners[:, 0]
    along = along - np.sum(along * side.outward, axis=1)[:, None] * side.outward
    along = along / np.linalg.norm(along, axis=1)[:, None]
    if side.points.shape[1] == 2:
        return np.asarray(along[:, None])
    return np.stack([along, np.cross(side.outward, along)], axis=1)


def _degree(side: Side) -> int:
    """The degree of a rule on the pieces of facets for products of the functions of their nodes.

    It is exact on simplices and parallelograms.  On another quadrilateral the functions are smooth
    where the Jacobian is not zero, and the error falls from each degree to the next by a factor
    near ``(1 - r)/(1 + r)``, where r^2 is the least quotient of the Jacobians at two corners.
    """
    if side.kind.is_simplex:
        return 4
    normals = [facet_normals(side.corners[:, list(three)]) for three in side.kind.beside]
    sizes = np.einsum("cmd,md->cm", np.array(normals), unit_normals(side.corners))
    ratio = np.sqrt(np.maximum(sizes.min(axis=0) / sizes.max(axis=0), 0.0))
    factor = float(((1.0 - ratio) / (1.0 + ratio)).max())
    more = math.log(_SMALL) / math.log(min(max(factor, _PARALLEL), _MOST_BENT))
    return (8 if side.is_quadratic else 4) + int(more)


def _bulge(side: Side) -> FloatArray:
    """The coefficients (m, c, c) of products of two functions, by which a side is farther out.

    They have nonzero entries above the diagonal.  At a corner of the body, whose normal is more
    than 15 degrees off that of the facet, the side is straight.  At an end of a curve the normal is
    that of the facet, and turns half as far to the other end of the edge as the curve does.
    """
    count, areas = side.kind.corners, side.sizes()
    normals = np.zeros_like(side.points)
    corners = side.facets[:, :count]
    for corner in corners.T:
        np.add.at(normals, corner, areas[:, None] * side.outward)
    sizes = np.linalg.norm(normals, axis=1)
    normals = (normals / np.where(sizes > 0.0, sizes, 1.0)[:, None])[corners]
    found = np.zeros((len(corners), count, count))
    for (i, j), ends in zip(_EDGES[count], _ends(side), strict=True):
        along = side.corners[:, j] - side.corners[:, i]
        length = np.linalg.norm(along, axis=1)[:, None]
        slopes = np.einsum("mci,mi->mc", normals[:, [i, j]], along / length)
        off = np.sum(normals[:, [i, j]] * side.outward[:, None], axis=2)
        slopes[off < _SMOOTH] = 0.0
        turns = np.where(ends, 2.0, 1.0) * (slopes[:, 1] - slopes[:, 0])
        found[:, i, j] = 0.5 * length[:, 0] * turns
    if count == 4:
        # The product is that of both diagonals, whose coefficients have the sum of all edges.
        found[:, 0, 3] = found.sum(axis=(1, 2))
    return found


def _ends(side: Side) -> BoolArray:
    """(e, m) whether a curve along each edge of the facets ends there: at a rim across the edge."""
    corners = side.facets[:, : side.kind.corners]
    rows = np.sort(side.kind.facets_of(corners), axis=1)
    _, inverse, number = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    is_rim = number[inverse.reshape(-1)] == 1
    at_rim = np.isin(corners, rows[is_rim])
    alone = np.bincount(corners.reshape(-1))[corners] == 1
    # Along the rim a curve ends in a corner of the side, which has one facet.
    edges = zip(_EDGES[side.kind.corners], is_rim.reshape(-1, len(corners)), strict=False)
    ends = [(alone | at_rim & ~along[:, None])[:, list(edge)] for edge, along in edges]
    return np.any(ends, axis=2)


def _candidates(one: Side, other: Side) -> tuple[IntArray, IntArray]:
    """The pairs (p,) of facets of both sides that may face each other."""
    from scipy.spatial import cKDTree

    middles, around = zip(*(_balls(side) for side in (one, other)), strict=True)
    tree = cKDTree(middles[1])
    largest = around[1].max(initial=0.0)
    distance = np.maximum(tree.query(middles[0])[0] - largest, 0.0)
    reach = _REACH * distance + around[0] + 2.0 * largest
    found = tree.query_ball_point(middles[0], reach, return_sorted=True)
    facet = np.repeat(np.arange(len(found)), [len(some) for some in found])
    facing = np.concatenate([np.empty(0, np.int64), *(np.asarray(x, np.int64) for x in found)])
    away = middles[1][facing] - middles[0][facet]
    outward = one.outward[facet]
    aside = np.sum(away**2, axis=1) - np.sum(away * outward, axis=1) ** 2
    near = aside <= (around[0][facet] + around[1][facing]) ** 2
    kept = near & (np.sum(outward * other.outward[facing], axis=1) < _FACING)
    return facet[kept], facing[kept]


def _of_the_nearest(
    one: Side, other: Side, facet: IntArray, facing: IntArray, may: BoolArray
) -> BoolArray:
    """(p,) the pairs that ``may`` be and have the body that is nearest to the facet of side 1."""
    assert other.bodies is not None
    away = other.corners.mean(axis=1)[facing] - one.corners.mean(axis=1)[facet]
    distance = np.where(may, np.linalg.norm(away, axis=1), np.inf)
    # The last entry for a facet is the nearest one.
    order = np.argsort(-distance, kind="stable")
    nearest = np.full(len(one.facets), -1)
    nearest[facet[order]] = other.bodies[facing[order]]
    return np.asarray(may & (other.bodies[facing] == nearest[facet]))


def _balls(side: Side) -> tuple[FloatArray, FloatArray]:
    """The middles (m, d) of the facets, and the radii (m,) of balls around them."""
    middles = side.corners.mean(axis=1)
    away = np.linalg.norm(side.corners - middles[:, None], axis=2)
    return middles, np.asarray(away.max(axis=1, initial=0.0))


def _boxes_meet(own: FloatArray, flat: FloatArray) -> BoolArray:
    """(p,) whether the boxes around facets (p, c, d - 1) have points in common."""
    low = np.maximum(own.min(axis=1), flat.min(axis=1))
    return np.all(low < np.minimum(own.max(axis=1), flat.max(axis=1)), axis=1)


def _overlaps(own: FloatArray, flat: FloatArray, kind: CellKind) -> tuple[IntArray, FloatArray]:
    """The intersections of facets ``own`` and ``flat`` (p, c, d - 1) of a kind.

    Returns simplices (q, d, d - 1), and the number (q,) of the pair of each.
    """
    if own.shape[2] == 1:
        low = np.maximum(own.min(axis=1), flat.min(axis=1))[:, 0]
        high = np.minimum(own.max(axis=1), flat.max(axis=1))[:, 0]
        number = np.flatnonzero(high > low)
        return number, np.stack([low, high], axis=1)[number][:, :, None]
    # Gmsh's order of corners goes around.
    around = list(kind.gmsh_order)
    return _common_triangles(_turned_left(own[:, around]), flat[:, around])


def _turned_left(polygons: FloatArray) -> FloatArray:
    """Convex polygons (p, v, 2) with their corners in mathematically positive order."""
    edges = np.diff(polygons, axis=1)
    left = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0] > 0.0
    return np.where(left[:, None, None], polygons, polygons[:, ::-1])


def _common_triangles(own: FloatArray, polygons: FloatArray) -> tuple[IntArray, FloatArray]:
    """Triangles of the intersections of convex polygons ``own`` (p, n, 2) and (p, v, 2).

    Each polygon is cut by the line of one edge of ``own`` after the other (Sutherland and Hodgman).
    """
    inside = np.ones(polygons.shape[:2], dtype=bool)
    for corner in range(own.shape[1]):
        start, end = own[:, corner - 1], own[:, corner]
        edge = end - start
        away = polygons - start[:, None]
        depth = edge[:, None, 0] * away[:, :, 1] - edge[:, None, 1] * away[:, :, 0]
        polygons, inside = _cut(polygons, inside, depth)
    fans = [
        (np.stack([polygons[:, 0], polygons[:, i], polygons[:, i + 1]], axis=1), inside[:, i + 1])
        for i in range(1, polygons.shape[1] - 1)
    ]
    number = np.concatenate([np.flatnonzero(there) for _, there in fans])
    triangles = np.concatenate([triangles[there] for triangles, there in fans])
    return number, triangles


def _cut(
    polygons: FloatArray, inside: BoolArray, depth: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """The parts of polygons (p, v, 2) with ``depth >= 0``, whose corners (p, v) are first.

    ``inside`` marks the corners that a polygon has, which are its first ones.
    """
    count = inside.sum(axis=1)
    following = np.arange(inside.shape[1])[None] + 1
    following = np.where(following < count[:, None], following, 0)
    rows = np.arange(len(polygons))[:, None]
    after, polygons_after = depth[rows, following], polygons[rows, following]
    keeps = inside & (depth >= 0.0)
    crosses = inside & ((depth > 0.0) & (after < 0.0) | (depth < 0.0) & (after > 0.0))
    share = depth / np.where(crosses, depth - after, 1.0)
    crossings = polygons + share[:, :, None] * (polygons_after - polygons)
    size = polygons.shape[1]
    both = np.stack([polygons, crossings], axis=2).reshape(len(polygons), 2 * size, 2)
    there = np.stack([keeps, crosses], axis=2).reshape(len(polygons), 2 * size)
    order = np.argsort(~there, axis=1, kind="stable")[:, : size + 1]
    return both[rows, order], there[rows, order]


def _quadrature(simplices: FloatArray, degree: int) -> tuple[FloatArray, FloatArray]:
    """Points (q, n, d - 1) and weights (q, n) of a rule on simplices (q, d, d - 1)."""
    cell = basix.CellType.interval if simplices.shape[2] == 1 else basix.CellType.triangle
    places, weights = basix.make_quadrature(cell, degree)
    edges = simplices[:, 1:] - simplices[:, :1]
    sizes = np.abs(np.linalg.det(edges))
    return simplices[:, :1] + places @ edges, sizes[:, None] * weights


def _dual_basis(mass: FloatArray) -> FloatArray:
    """The coefficients (m, n, n) of the dual functions in functions with these masses.

    A small covered part leaves functions of very different sizes, which are scaled first.
    """
    scale = 1.0 / np.sqrt(np.einsum("mii->mi", mass))
    scaled = np.linalg.inv(mass * scale[:, :, None] * scale[:, None])
    return np.asarray(mass.sum(axis=2)[:, :, None] * scale[:, :, None] * scaled * scale[:, None])


def _summed(numbers: IntArray, count: int, values: FloatArray) -> FloatArray:
    """The sums (count, i, j) of values (q, i, j) with the same number (q,)."""
    from scipy.sparse import csr_matrix

    ones = np.ones(len(numbers))
    gather = csr_matrix((ones, (numbers, np.arange(len(numbers)))), shape=(count, len(numbers)))
    sums = gather @ values.reshape(len(values), math.prod(values.shape[1:]))
    return np.asarray(sums.reshape(count, *values.shape[1:]))


def _functions(kind: CellKind, corners: FloatArray, points: FloatArray) -> FloatArray:
    """The functions of degree 1 (q, n, c) of the corners (q, c, d) at points (q, n, d).

    On simplices these are the barycentric coordinates; quadrilaterals are convex.
    """
    if kind.is_simplex:
        edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
        away = (points - corners[:, :1]).transpose(0, 2, 1)
        places = np.asarray(np.linalg.solve(edges, away).transpose(0, 2, 1), dtype=float)
    else:
        a, b, c, d = (corners[:, i : i + 1] for i in range(4))
        b, c, d, y = b - a, c - a, d - b - c + a, points - a
        turn = np.sign(_cross(b, c))
        area, bend, along = turn * _cross(b, c), turn * _cross(y, d), turn * _cross(y, c)
        jacobian = np.sqrt(np.maximum((area - bend) ** 2 + 4.0 * turn * _cross(b, d) * along, 0.0))
        s = 2.0 * along / (area - bend + jacobian)
        t = 2.0 * turn * _cross(b, y) / (area + bend + jacobian)
        places = np.stack([s, t], axis=2).astype(np.float64)
    return kind.basis(places.reshape(-1, kind.dim)).reshape(*points.shape[:2], kind.corners)


def _bernstein(linear: FloatArray) -> FloatArray:
    """Bernstein's functions (..., n) of degree 2 at the values (..., c) of those of degree 1.

    They are those of the corners, of the edges, and of the middle of a quadrilateral.
    """
    found = [linear**2]
    found += [2.0 * linear[..., [i]] * linear[..., [j]] for i, j in _EDGES[linear.shape[-1]]]
    if linear.shape[-1] == 4:
        found.append(4.0 * linear[..., [0]] * linear[..., [3]])
    return np.concatenate(found, axis=-1)


def _nodal(linear: FloatArray) -> FloatArray:
    """The functions (..., n) of degree 2 of the nodes, as :func:`_bernstein`."""
    unit = np.eye(linear.shape[-1])
    ends = [[i, j] for i, j in _EDGES[len(unit)]] + [[0, 1, 2, 3]] * (len(unit) == 4)
    nodes = np.array([*unit, *(unit[some].mean(axis=0) for some in ends)])
    return np.asarray(_bernstein(linear) @ np.linalg.inv(_bernstein(nodes)))


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])
