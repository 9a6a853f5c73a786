"""The functions of the nodes of facets at points of their planes.

A point of a plane quadrilateral is ``x = a + b s + c t + d s t`` with s and t from 0 to 1.  With
the cross product, y = x - a, and the Jacobian J there,

    s = 2 (y x c)/(b x c - y x d + J),   t = 2 (b x y)/(b x c + y x d + J),
    J^2 = (b x c - y x d)^2 + 4 (b x d)(y x c),

whose denominators are twice the Jacobian at the sides s = 0 and t = 0.
"""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.mesh.cell_kind import CellKind

#: The edges of facets, as their corners, by the number of corners, in the order of DOLFINx.
EDGES = {2: [(0, 1)], 3: [(1, 2), (0, 2), (0, 1)], 4: [(0, 1), (0, 2), (1, 3), (2, 3)]}


def functions(kind: CellKind, corners: FloatArray, points: FloatArray) -> FloatArray:
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


def bernstein(linear: FloatArray) -> FloatArray:
    """Bernstein's functions (..., n) of degree 2 at the values (..., c) of those of degree 1.

    They are those of the corners, of the edges, and of the middle of a quadrilateral.
    """
    found = [linear**2]
    found += [2.0 * linear[..., [i]] * linear[..., [j]] for i, j in EDGES[linear.shape[-1]]]
    if linear.shape[-1] == 4:
        found.append(4.0 * linear[..., [0]] * linear[..., [3]])
    return np.concatenate(found, axis=-1)


def nodal(linear: FloatArray) -> FloatArray:
    """The functions (..., n) of degree 2 of the nodes, as :func:`bernstein`."""
    unit = np.eye(linear.shape[-1])
    ends = [[i, j] for i, j in EDGES[len(unit)]] + [[0, 1, 2, 3]] * (len(unit) == 4)
    nodes = np.array([*unit, *(unit[some].mean(axis=0) for some in ends)])
    return np.asarray(bernstein(linear) @ np.linalg.inv(bernstein(nodes)))


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])
