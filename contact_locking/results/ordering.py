"""Orders of the points of Gamma_C by geometry alone, and curves through points."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from contact_locking.arrays import FloatArray, IntArray


def lexicographic(x: FloatArray) -> IntArray:
    """The order of points (k, d) by x, then y, then z; rounding does not change the order."""
    size = float(np.ptp(x, axis=0).max()) if len(x) else 1.0
    return np.lexsort(np.round(x / (size or 1.0), 9).T[::-1])


def facets_of(x: FloatArray, corners: FloatArray) -> IntArray:
    """Facets (m, d) as numbers of points x (k, d), from the coordinates (m, d, d) of their corners.

    Every facet occurs once, with ascending numbers, and the facets are sorted.
    """
    numbers = cKDTree(x).query(corners)[1]
    return np.unique(np.sort(numbers, axis=1), axis=0).astype(np.int64)


def curves(segments: IntArray) -> list[IntArray]:
    """The curves that consist of segments (m, 2) of numbered points, as numbers of their points.

    An open curve begins at the end with the lower number.  A closed curve begins at its lowest
    number, goes to the lower neighbour, and repeats its first point at the end.  The curves are
    sorted by their first points.
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

    The points are numbered lexicographically; for the start of each curve see `curves`.
    """
    order = lexicographic(x)
    walked = curves(cKDTree(x[order]).query(segments)[1])
    # A point where curves meet is on several curves and must occur once.
    return order[list(dict.fromkeys(int(point) for curve in walked for point in curve))]
