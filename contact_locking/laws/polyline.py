"""A rigid foundation in the plane whose outline is a polyline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray

# As many distances between points and segments are computed at once.
_AT_ONCE = 1 << 20
# A ray runs along a side if the cosine of its angle with the normal is smaller, and a ray that
# misses the end of a side by this share of the side is rounding.
_GRAZING = 1e-9


@dataclass(frozen=True)
class Nearest:
    """For k points the nearest ``place`` (2, k), its ``segment`` (k,) and its ``share`` of it."""

    place: FloatArray
    segment: IntArray
    share: FloatArray


@dataclass(frozen=True)
class Polyline:
    """The signed distance to a polyline, positive on the right of the way along ``corners`` (m, 2).

    The foundation is on the left, so that a closed outline runs counterclockwise around it.  The
    line is closed if its last corner is the first.  At a corner the sign is that of the mean of the
    normals of both segments, and beyond an open end that of the end's segment.
    """

    corners: FloatArray

    @property
    def is_closed(self) -> bool:
        """Whether the line ends where it begins."""
        return bool(np.array_equal(self.corners[0], self.corners[-1]))

    @property
    def extent(self) -> float:
        """The longest edge of the line's bounding box."""
        return float(np.ptp(self.corners, axis=0).max())

    @property
    def facets(self) -> FloatArray:
        """The ends (m - 1, 2, 2) of the segments."""
        return np.stack([self.corners[:-1], self.corners[1:]], axis=1)

    @property
    def content(self) -> float | None:
        """``(1/2) sum (x_i y_i+1 - x_i+1 y_i)``: the area inside a closed line, None if it is open.

        The area is negative if the foundation is around the line, as a die is.
        """
        if not self.is_closed:
            return None
        x, y = (self.corners - self.corners[0]).T
        return float(0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))

    def sharp_points(self, box: FloatArray, spacing: float) -> FloatArray:
        """The corners (c, 2) in a box (2, 2)."""
        inside = np.all((self.corners >= box[0]) & (self.corners <= box[1]), axis=1)
        return np.asarray(self.corners[inside])

    def reversed(self) -> Polyline:
        """The line with the foundation on its other side."""
        return Polyline(self.corners[::-1])

    def way_out(self, x: FloatArray, towards: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where rays from points (2, k) inside first leave the foundation.

        ``towards`` (2, k) are the directions of the rays.  Returns the depth (k,) of each point
        below the segment that its ray leaves through, inf without one, and the outward normal
        (2, k) of this segment.
        """
        tangent, along = self._directions(), np.diff(self.corners, axis=0)
        normals = np.array([tangent[1], -tangent[0]])
        depths, found = np.full(x.shape[1], np.inf), np.zeros(x.shape)
        for number, (place, ray) in enumerate(zip(x.T, towards.T, strict=True)):
            away = self.corners[:-1] - place
            slope = ray @ normals
            leaves = slope > _GRAZING
            depth = np.einsum("mi,im->m", away, normals)
            way = np.divide(depth, slope, out=np.full(len(slope), np.inf), where=leaves)
            met = np.where(leaves, way, 0.0)[:, None] * ray - away
            share = np.sum(met * along, axis=1) / np.sum(along**2, axis=1)
            leaves &= (way > 0.0) & (np.abs(share - 0.5) <= 0.5 + _GRAZING)
            if leaves.any():
                first = int(np.argmin(np.where(leaves, way, np.inf)))
                depths[number], found[:, number] = depth[first], normals[:, first]
        return depths, found

    def gap(self, x: FloatArray) -> FloatArray:
        return self._signed(x)[0]

    def contact_normal(self, x: FloatArray) -> FloatArray:
        return -self._signed(x)[1]

    def at_open_end(self, x: FloatArray) -> BoolArray:
        """(k,) whether an open end of the line is nearest to each point (2, k), beyond the end."""
        if self.is_closed:
            return np.zeros(x.shape[1], dtype=bool)
        found, last = self._nearest(x), len(self.corners) - 2
        beyond = (found.segment == 0) & (found.share == 0.0)
        beyond |= (found.segment == last) & (found.share == 1.0)
        away = x - found.place
        along = self._directions()[:, found.segment]
        # At the end itself, and straight above it, the line is met at a right angle.
        size = np.linalg.norm(away, axis=0)
        return np.asarray(beyond & (np.abs(np.sum(away * along, axis=0)) > 1e-9 * size))

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

    def _directions(self) -> FloatArray:
        """The unit tangents (2, m - 1) of the segments."""
        along = np.diff(self.corners, axis=0)
        return np.asarray((along / np.linalg.norm(along, axis=1)[:, None]).T)

    def _signed(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The distance (k,) and its gradient (2, k) at points (2, k)."""
        found = self._nearest(x)
        tangent = self._directions()
        normals = np.array([tangent[1], -tangent[0]])
        count = normals.shape[1]
        before, after = found.segment.copy(), found.segment.copy()
        at_start, at_end = found.share == 0.0, found.share == 1.0
        before[at_start] -= 1
        after[at_end] += 1
        if self.is_closed:
            before, after = before % count, after % count
        before, after = np.clip(before, 0, count - 1), np.clip(after, 0, count - 1)
        pseudo = normals[:, before] + normals[:, after]
        pseudo = pseudo / np.linalg.norm(pseudo, axis=0)
        away = x - found.place
        distance = np.linalg.norm(away, axis=0)
        sign = np.where(np.sum(away * pseudo, axis=0) >= 0.0, 1.0, -1.0)
        # On the line itself, to rounding, the normal of the line is the direction.
        size = np.abs(self.corners).max(initial=np.finfo(float).tiny)
        on = distance <= 1e-14 * size
        direction = sign * away / np.where(on, 1.0, distance)
        return sign * distance, np.where(on, pseudo, direction)

    def _nearest(self, x: FloatArray) -> Nearest:
        start, along = self.corners[:-1], np.diff(self.corners, axis=0)
        square = np.sum(along**2, axis=1)
        rows = max(_AT_ONCE // len(along), 1)
        segments, shares = [], []
        for part in np.array_split(x.T, max(len(x.T) // rows, 1)):
            away = part[:, None] - start
            share = np.clip(np.einsum("kmi,mi->km", away, along) / square, 0.0, 1.0)
            left = away - share[:, :, None] * along
            nearest = np.argmin(np.sum(left**2, axis=2), axis=1)
            segments.append(nearest)
            shares.append(share[np.arange(len(part)), nearest])
        segment, share = np.concatenate(segments), np.concatenate(shares)
        place = start[segment] + share[:, None] * along[segment]
        return Nearest(place.T, segment, share)


def _cross(a: FloatArray, b: FloatArray) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _folds_back(first: FloatArray, second: FloatArray, offset: FloatArray) -> bool:
    """Whether of two neighbours one runs back along the other."""
    return _cross(first, second) == 0.0 and float(first @ second) < 0.0


def _meet(first: FloatArray, second: FloatArray, offset: FloatArray) -> bool:
    """Whether two segments with overlapping boxes meet; ``offset`` is from start to start."""
    across = _cross(first, offset) * _cross(first, offset + second)
    return across <= 0.0 and _cross(second, -offset) * _cross(second, first - offset) <= 0.0
