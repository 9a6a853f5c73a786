"""An order of the points of Gamma_C that depends on the geometry alone."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def lexicographic(x: FloatArray) -> IntArray:
    """The order of points (k, d) by x, then y, then z; the last digits do not count."""
    size = float(np.ptp(x, axis=0).max()) if len(x) else 1.0
    return np.lexsort(np.round(x / (size or 1.0), 9).T[::-1])


def facets_of(x: FloatArray, corners: FloatArray) -> IntArray:
    """Facets (m, d) as numbers of the points x (k, d) that their corners (m, d, d) are.

    Each once, its numbers ascending, in ascending order.
    """
    numbers = cKDTree(x).query(corners)[1]
    return np.unique(np.sort(numbers, axis=1), axis=0).astype(np.int64)


def along_curve(x: FloatArray, segments: FloatArray) -> IntArray:
    """The order of points (k, 2) along the curves made of ``segments`` (s, 2, 2).

    Each connected curve is walked from its lexicographically first end, a closed one from its
    first point in the direction of its first neighbour; curves come in the order of their starts.
    """
    rank = np.empty(len(x), dtype=np.int64)
    rank[lexicographic(x)] = np.arange(len(x))
    neighbours: list[list[int]] = [[] for _ in x]
    for a, b in cKDTree(x).query(segments)[1]:
        neighbours[a].append(int(b))
        neighbours[b].append(int(a))
    for found in neighbours:
        found.sort(key=rank.__getitem__)
    is_end = np.array([len(found) <= 1 for found in neighbours], dtype=bool)
    starts = sorted(range(len(x)), key=lambda i: (not is_end[i], rank[i]))
    seen = np.zeros(len(x), dtype=bool)
    walks: list[list[int]] = []
    for start in starts:
        walk: list[int] = []
        here: int | None = start
        while here is not None and not seen[here]:
            seen[here] = True
            walk.append(here)
            here = next((i for i in neighbours[here] if not seen[i]), None)
        if walk:
            walks.append(walk)
    walks.sort(key=lambda walk: rank[walk[0]])
    return np.array([i for walk in walks for i in walk], dtype=np.int64)
