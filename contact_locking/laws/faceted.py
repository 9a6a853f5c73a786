"""Rigid foundations whose surface consists of facets: segments in the plane, triangles in space."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray

# As many distances between points and segments are computed at once.
_AT_ONCE = 1 << 20
# A ray runs along a facet if the cosine of its angle with the normal is smaller, and a ray that
# misses a facet by this share of its size is rounding.
_GRAZING = 1e-9


class FacetedFoundation(ABC):
    """The signed distance to facets, positive on the side of their normals."""

    @property
    @abstractmethod
    def facets(self) -> FloatArray:
        """The corners (m, d, d) of the facets."""

    @property
    @abstractmethod
    def is_closed(self) -> bool:
        """Whether the surface has no rim."""

    @abstractmethod
    def gap(self, x: FloatArray) -> FloatArray:
        """The distance (k,) of points (d, k), negative inside the foundation."""

    @abstractmethod
    def contact_normal(self, x: FloatArray) -> FloatArray:
        """Unit vectors (d, k) into the foundation."""

    @abstractmethod
    def reversed(self) -> FacetedFoundation:
        """The surface with the foundation on its other side."""

    @abstractmethod
    def sharp_points(self, box: FloatArray, spacing: float) -> FloatArray:
        """The corners in a box (2, d), and points ``spacing`` apart of sharp edges: (c, d)."""

    @abstractmethod
    def at_open_end(self, x: FloatArray) -> BoolArray:
        """(k,) whether the rim of an open surface is nearest to each point (d, k)."""

    @property
    def extent(self) -> float:
        """The longest edge of the bounding box."""
        return float(np.ptp(self.facets, axis=(0, 1)).max())

    @property
    def content(self) -> float | None:
        """``sum det(corners)/d!``: the area or volume inside, None if the surface is open.

        It is negative if the foundation is around the surface, as a die is.
        """
        if not self.is_closed:
            return None
        dim = self.facets.shape[2]
        middle = self.facets.mean(axis=(0, 1))
        return float(np.linalg.det(self.facets - middle).sum()) / math.factorial(dim)

    @cached_property
    def normals(self) -> FloatArray:
        """The outward unit normals (m, d) of the facets."""
        edges = self.facets[:, 1:] - self.facets[:, :1]
        if edges.shape[2] == 2:
            found = edges[:, 0, ::-1] * np.array([1.0, -1.0])
        else:
            found = np.cross(edges[:, 0], edges[:, 1])
        return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])

    def way_out(self, x: FloatArray, towards: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where rays from points (d, k) inside first leave the foundation.

        ``towards`` (d, k) are the directions of the rays.  Returns the depth (k,) of each point
        below the facet that its ray leaves through, inf without one, and the outward normal (d, k)
        of this facet.
        """
        start, normals = self.facets[:, 0], self.normals
        to_shares = np.linalg.pinv(np.swapaxes(self.facets[:, 1:] - start[:, None], 1, 2))
        depths, found = np.full(x.shape[1], np.inf), np.zeros(x.shape)
        for number, (place, ray) in enumerate(zip(x.T, towards.T, strict=True)):
            away, slope = start - place, normals @ ray
            leaves = slope > _GRAZING
            depth = np.sum(away * normals, axis=1)
            way = np.divide(depth, slope, out=np.full(len(slope), np.inf), where=leaves)
            met = np.where(leaves, way, 0.0)[:, None] * ray - away
            shares = np.einsum("msd,md->ms", to_shares, met)
            least = np.minimum(shares.min(axis=1), 1.0 - shares.sum(axis=1))
            leaves &= (way > 0.0) & (least >= -_GRAZING)
            if leaves.any():
                first = int(np.argmin(np.where(leaves, way, np.inf)))
                depths[number], found[:, number] = depth[first], normals[first]
        return depths, found


def nearest_on_segments(
    points: FloatArray, segments: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """The nearest places (k, d) to points (k, d) of segments (m, 2, d).

    Returns also the segment (k,) of each place, and its share (k,) of it.
    """
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    square = np.sum(along**2, axis=1)
    rows = max(_AT_ONCE // len(along), 1)
    numbers, found = [], []
    for part in np.array_split(points, max(len(points) // rows, 1)):
        away = part[:, None] - start
        shares = np.clip(np.einsum("kmi,mi->km", away, along) / square, 0.0, 1.0)
        left = away - shares[:, :, None] * along
        nearest = np.argmin(np.sum(left**2, axis=2), axis=1)
        numbers.append(nearest)
        found.append(shares[np.arange(len(part)), nearest])
    number, share = np.concatenate(numbers), np.concatenate(found)
    return start[number] + share[:, None] * along[number], number, share
