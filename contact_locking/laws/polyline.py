"""A rigid foundation in the plane whose outline is a polyline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.laws.faceted import FacetedFoundation, nearest_on_segments


@dataclass(frozen=True)
class Polyline(FacetedFoundation):
    """The signed distance to a polyline, positive on the right of the way along ``corners`` (m, 2).

    The foundation is on the left, so that a closed outline runs counterclockwise around it.  The
    line is closed if its last corner is the first.  At a corner the sign is that of the mean of the
    normals of both segments, and beyond an open end that of the end's segment.
    """

    corners: FloatArray

    @property
    def is_closed(self) -> bool:
        return bool(np.array_equal(self.corners[0], self.corners[-1]))

    @property
    def facets(self) -> FloatArray:
        return np.stack([self.corners[:-1], self.corners[1:]], axis=1)

    def sharp_points(self, box: FloatArray, spacing: float) -> FloatArray:
        inside = np.all((self.corners >= box[0]) & (self.corners <= box[1]), axis=1)
        return np.asarray(self.corners[inside])

    def reversed(self) -> Polyline:
        return Polyline(self.corners[::-1])

    def gap(self, x: FloatArray) -> FloatArray:
        return self._signed(x)[0]

    def contact_normal(self, x: FloatArray) -> FloatArray:
        return -self._signed(x)[1]

    def at_open_end(self, x: FloatArray) -> BoolArray:
        if self.is_closed:
            return np.zeros(x.shape[1], dtype=bool)
        places, segment, share = nearest_on_segments(x.T, self.facets)
        beyond = (segment == 0) & (share == 0.0)
        beyond |= (segment == len(self.corners) - 2) & (share == 1.0)
        away = x.T - places
        # At the end itself, and straight above it, the line is met at a right angle.
        size = np.linalg.norm(away, axis=1)
        return np.asarray(beyond & (np.abs(_cross(away.T, self.normals[segment].T)) > 1e-9 * size))

    def crossing(self) -> tuple[int, int] | None:
        """The numbers of two segments that meet without being neighbours; None if no two do."""
        start, end = self.corners[:-1], self.corners[1:]
        count = len(start)
        low, high = np.minimum(start, end), np.maximum(start, end)
        for one in range(count - 1):
            rest = slice(one + 1, count)
            near = np.all((low[one] <= high[rest]) & (high[one] >= low[rest]), axis=1)
            for other in map(int, one + 1 + np.flatnonzero(near)):
                follows = other == one + 1 or (self.is_closed and other - one == count - 1)
                test = _folds_back if follows else _meet
                if test(
                    end[one] - start[one], end[other] - start[other], start[other] - start[one]
                ):
                    return one, other
        return None

    def _signed(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The distance (k,) and its gradient (2, k) at points (2, k)."""
        places, segment, share = nearest_on_segments(x.T, self.facets)
        normals, count = self.normals, len(self.normals)
        before, after = segment - (share == 0.0), segment + (share == 1.0)
        if self.is_closed:
            before, after = before % count, after % count
        before, after = np.clip(before, 0, count - 1), np.clip(after, 0, count - 1)
        pseudo = normals[before] + normals[after]
        pseudo = pseudo / np.linalg.norm(pseudo, axis=1)[:, None]
        away = x.T - places
        distance = np.linalg.norm(away, axis=1)
        sign = np.where(np.sum(away * pseudo, axis=1) >= 0.0, 1.0, -1.0)
        # On the line itself, to rounding, the normal of the line is the direction.
        size = np.abs(self.corners).max(initial=np.finfo(float).tiny)
        on = distance <= 1e-14 * size
        direction = (sign / np.where(on, 1.0, distance))[:, None] * away
        return sign * distance, np.where(on[:, None], pseudo, direction).T


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[0] * b[1] - a[1] * b[0])


def _folds_back(first: FloatArray, second: FloatArray, offset: FloatArray) -> bool:
    """Whether of two neighbours one runs back along the other."""
    return bool(_cross(first, second) == 0.0 and first @ second < 0.0)


def _meet(first: FloatArray, second: FloatArray, offset: FloatArray) -> bool:
    """Whether two segments with overlapping boxes meet; ``offset`` is from start to start."""
    across = _cross(first, offset) * _cross(first, offset + second)
    back = _cross(second, -offset) * _cross(second, first - offset)
    return bool(across <= 0.0 and back <= 0.0)
