"""Orders of the points of Gamma_C that depend on the geometry alone, and curves through points."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from contact_locking.arrays import FloatArray, IntArray


def lexicographic(x: FloatArray) -> IntArray:
    """The order of points (k, d) by x, then y, then z; differences by rounding do not count."""
    size = float(np.ptp(x, axis=0).max()) if len(x) else 1.0
    return np.lexsort(np.round(x / (size or 1.0), 9).T[::-1])


def facets_of(x: FloatArray, corners: FloatArray) -> IntArray:
    """Facets (m, d) as numbers of points x (k, d), given the places (m, d, d) of their corners.

    Every facet comes once, with ascending numbers, and the facets are in ascending order.
    """
    numbers = cKDTree(x).query(corners)[1]
    return np.unique(np.sort(numbers, axis=1), axis=0).astype(np.int64)


def curves(segments: IntArray) -> list[IntArray]:
    """The curves that segments (m, 2) of numbered points make up, as numbers of their points.

    Each curve begins at its end with the lowest number.  A closed curve begins at its lowest number
    in the direction of the lower neighbour, and repeats its first point.  The curves come in the
    order of their first points.
    """
    neighbours: dict[int, list[int]] = {}
    for a, b in np.unique(np.sort(segments, axis=1), axis=0):
        neighbours.setdefault(int(a), []).append(int(b))
        neighbours.setdefault(int(b), []).append(int(a))
    for joined in neighbours.values():
        joined.sort()
    ends = [point for point, joined in neighbours.items() if len(joined) == 1]
    found = []
    for start in [*sorted(ends), *sorted(neighbours)]:
        curve = [start]
        while neighbours[curve[-1]]:
            following = neighbours[curve[-1]].pop(0)
            neighbours[following].remove(curve[-1])
            curve.append(following)
        if len(curve) > 1:
            found.append(np.array(curve, dtype=np.int64))
    return sorted(found, key=lambda curve: int(curve[0]))


def along_curves(x: FloatArray, segments: FloatArray) -> IntArray:
    """The order of points (k, 2) along the curves made of ``segments`` (s, 2, 2).

    The points are numbered lexicographically; `curves` tells where each curve begins.
    """
    order = lexicographic(x)
    walked = curves(cKDTree(x[order]).query(segments)[1])
    # A curve that meets itself or another one passes a point twice.
    return order[list(dict.fromkeys(int(point) for curve in walked for point in curve))]
