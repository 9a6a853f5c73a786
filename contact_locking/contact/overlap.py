"""Overlaps of facets in a plane, quadrature on them, and the functions of nodes there.

A point of a plane quadrilateral is ``x = a + b s + c t + d s t`` with s and t from 0 to 1.  With
the cross product, y = x - a, and the Jacobian J there,

    s = 2 (y x c)/(b x c - y x d + J),   t = 2 (b x y)/(b x c + y x d + J),
    J^2 = (b x c - y x d)^2 + 4 (b x d)(y x c),

whose denominators are twice the Jacobian at the sides s = 0 and t = 0.
"""

from __future__ import annotations

import math

import basix
import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.mesh.data import CellKind, facet_normals, unit_normals

# By this factor the integrals of functions over quadrilaterals become more accurate than by a rule
# that is exact for parallelograms, which these are up to a factor of rounding.  The last factor is
# that of quadrilaterals with Jacobians of 1 and 1/6; more bent ones have the rule of these.
_SMALL, _PARALLEL, _MOST_BENT = 1e-12, 1e-16, 0.42

#: The edges of facets, as their corners, by the number of corners, in the order of DOLFINx.
EDGES = {2: [(0, 1)], 3: [(1, 2), (0, 2), (0, 1)], 4: [(0, 1), (0, 2), (1, 3), (2, 3)]}


def axes_across(normals: FloatArray) -> FloatArray:
    """Orthonormal vectors (k, d - 1, d) across unit vectors (k, d)."""
    if normals.shape[1] == 2:
        return np.stack([-normals[:, 1], normals[:, 0]], axis=1)[:, None]
    least = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = np.cross(normals, least)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(normals, first)], axis=1)


def boxes_meet(first: FloatArray, flat: FloatArray) -> BoolArray:
    """(p,) whether the boxes around facets (p, c, d - 1) have points in common."""
    low = np.maximum(first.min(axis=1), flat.min(axis=1))
    return np.all(low < np.minimum(first.max(axis=1), flat.max(axis=1)), axis=1)


def overlaps(first: FloatArray, flat: FloatArray, kind: CellKind) -> tuple[IntArray, FloatArray]:
    """The intersections of facets ``first`` and ``flat`` (p, c, d - 1) of a kind.

    Returns simplices (q, d, d - 1), and the number (q,) of the pair of each.
    """
    if first.shape[2] == 1:
        low = np.maximum(first.min(axis=1), flat.min(axis=1))[:, 0]
        high = np.minimum(first.max(axis=1), flat.max(axis=1))[:, 0]
        number = np.flatnonzero(high > low)
        return number, np.stack([low, high], axis=1)[number][:, :, None]
    # Gmsh's order of corners goes around.
    around = list(kind.gmsh_order)
    clips, edges = first[:, around], np.diff(first[:, around], axis=1)
    is_left = _cross(edges[:, 0], edges[:, 1]) > 0.0
    clips = np.where(is_left[:, None, None], clips, clips[:, ::-1])
    return _common_triangles(clips, flat[:, around])


def _common_triangles(clips: FloatArray, polygons: FloatArray) -> tuple[IntArray, FloatArray]:
    """Triangles of the intersections of convex polygons ``clips`` (p, n, 2) and (p, v, 2).

    Each polygon is cut by the line of one edge of ``clips`` after another (Sutherland, Hodgman).
    """
    inside = np.ones(polygons.shape[:2], dtype=bool)
    for corner in range(clips.shape[1]):
        start, end = clips[:, corner - 1], clips[:, corner]
        edge = end - start
        away = polygons - start[:, None]
        depth = edge[:, None, 0] * away[:, :, 1] - edge[:, None, 1] * away[:, :, 0]
        polygons, inside = _cut(polygons, inside, depth)
    fans = [
        (np.stack([polygons[:, 0], polygons[:, i], polygons[:, i + 1]], axis=1), inside[:, i + 1])
        for i in range(1, polygons.shape[1] - 1)
    ]
    number = np.concatenate([np.flatnonzero(is_inside) for _, is_inside in fans])
    triangles = np.concatenate([triangles[is_inside] for triangles, is_inside in fans])
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
    exists = np.stack([keeps, crosses], axis=2).reshape(len(polygons), 2 * size)
    order = np.argsort(~exists, axis=1, kind="stable")[:, : size + 1]
    return both[rows, order], exists[rows, order]


def quadrature(simplices: FloatArray, degree: int) -> tuple[FloatArray, FloatArray]:
    """Points (q, n, d - 1) and weights (q, n) of a rule on simplices (q, d, d - 1)."""
    cell = basix.CellType.interval if simplices.shape[2] == 1 else basix.CellType.triangle
    places, weights = basix.make_quadrature(cell, degree)
    edges = simplices[:, 1:] - simplices[:, :1]
    sizes = np.abs(np.linalg.det(edges))
    return simplices[:, :1] + places @ edges, sizes[:, None] * weights


def summed(numbers: IntArray, count: int, values: FloatArray) -> FloatArray:
    """The sums (count, i, j) of values (q, i, j) with the same number (q,)."""
    from scipy.sparse import csr_matrix

    ones = np.ones(len(numbers))
    gather = csr_matrix((ones, (numbers, np.arange(len(numbers)))), shape=(count, len(numbers)))
    sums = gather @ values.reshape(len(values), math.prod(values.shape[1:]))
    return np.asarray(sums.reshape(count, *values.shape[1:]))


def degree_of(kind: CellKind, corners: FloatArray) -> int:
    """The degree of a rule on the pieces of facets for products of the functions of their nodes.

    It is exact on simplices and parallelograms.  On another quadrilateral the functions are smooth
    where the Jacobian is not zero, and the error falls from each degree to the next by a factor
    near ``(1 - r)/(1 + r)``, where r^2 is the least quotient of the Jacobians at two corners.
    """
    if kind.is_simplex:
        return 4
    normals = [facet_normals(corners[:, list(three)]) for three in kind.beside]
    sizes = np.einsum("cmd,md->cm", np.array(normals), unit_normals(corners))
    ratio = np.sqrt(np.maximum(sizes.min(axis=0) / sizes.max(axis=0), 0.0))
    factor = float(((1.0 - ratio) / (1.0 + ratio)).max())
    further = math.log(_SMALL) / math.log(min(max(factor, _PARALLEL), _MOST_BENT))
    return 4 + int(further)


def functions(kind: CellKind, corners: FloatArray, points: FloatArray) -> FloatArray:
    """The functions of degree 1 (q, n, c) of the corners (q, c, d) at points (q, n, d).

    On simplices these are the barycentric coordinates; quadrilaterals are convex.  They are not
    numbers where the corners span nothing, as those of a facet that is seen from its side.
    """
    if kind.is_simplex:
        edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
        away = (points - corners[:, :1]).transpose(0, 2, 1)
        is_flat = np.linalg.det(edges) == 0.0
        edges = np.where(is_flat[:, None, None], np.eye(edges.shape[1]), edges)
        places = np.asarray(np.linalg.solve(edges, away).transpose(0, 2, 1), dtype=float)
        places[is_flat] = np.nan
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


def bernstein(linear: FloatArray) -> FloatArray:
    """Bernstein's functions (..., n) of degree 2 at the values (..., c) of those of degree 1.

    They are those of the corners and of the edges of a simplex.
    """
    values = [linear**2]
    values += [2.0 * linear[..., [i]] * linear[..., [j]] for i, j in EDGES[linear.shape[-1]]]
    return np.concatenate(values, axis=-1)


def nodal(linear: FloatArray) -> FloatArray:
    """The functions (..., n) of degree 2 of the nodes, as :func:`bernstein`."""
    unit = np.eye(linear.shape[-1])
    nodes = np.array([*unit, *(unit[[i, j]].mean(axis=0) for i, j in EDGES[len(unit)])])
    return np.asarray(bernstein(linear) @ np.linalg.inv(bernstein(nodes)))


def dual_basis(mass: FloatArray) -> FloatArray:
    """The coefficients (m, n, n) of the dual functions in functions with these masses.

    A small covered part leaves functions of very different sizes, which are scaled first.  Rows of
    zeros stand for no function.
    """
    sizes = np.einsum("mii->mi", mass)
    scale = 1.0 / np.sqrt(np.where(sizes > 0.0, sizes, 1.0))
    scaled = mass * scale[:, :, None] * scale[:, None]
    np.einsum("mii->mi", scaled)[:] = 1.0
    inverse = np.linalg.inv(scaled)
    return np.asarray(mass.sum(axis=2)[:, :, None] * scale[:, :, None] * inverse * scale[:, None])


def _cross(first: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(first[..., 0] * other[..., 1] - first[..., 1] * other[..., 0])
