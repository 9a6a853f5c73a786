"""Rigid foundations whose surface consists of facets: segments in the plane, triangles in space."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, Tag, model_validator

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.findings import Finding
from contact_locking.shapes.shape import Shape
from contact_locking.values.concept import (
    LIST,
    ONLY,
    TEXT,
    BodyKind,
    Components,
    Fault,
    entry,
    hidden,
)
from contact_locking.values.kinds import File, Number, Positive, Switch, list_or, plain

if TYPE_CHECKING:
    from mpi4py import MPI

# A longer polyline is not read.
_MOST_CORNERS = 10_000
# As many distances between points and segments are computed at once.
_AT_ONCE = 1 << 20
# A ray runs along a facet if the cosine of its angle with the normal is smaller, and a ray that
# misses a facet by this share of its size is rounding.
_GRAZING = 1e-9
_INSTALL = "apt-get install python3-vtk9, or pip install vtk"
# Nearer to the surface than this share of its size, the direction to the nearest point is rounding,
# and differences of the distance give the normal.
_NEAR = 1e-6
# The cosine of the angle between the normals beside a sharp edge, 10 degrees.
_SHARP = 0.985


class FacetedFoundation(Shape):
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
    def reversed(self) -> FacetedFoundation:
        """The surface with the foundation on its other side."""

    @abstractmethod
    def sharp_points(self, box: FloatArray, spacing: float) -> FloatArray:
        """The corners in a box (2, d), and points ``spacing`` apart of sharp edges: (c, d)."""

    @abstractmethod
    def at_open_end(self, x: FloatArray) -> BoolArray:
        """(k,) whether the rim of an open surface is nearest to each point (d, k)."""

    @cached_property
    def extent(self) -> float:
        """The longest edge of the bounding box."""
        return float(np.ptp(self.facets, axis=(0, 1)).max())

    @property
    def is_around(self) -> bool:
        """Whether it is closed with a negative content ``sum det(corners)``, as a die."""
        middle = self.facets.mean(axis=(0, 1))
        return self.is_closed and float(np.linalg.det(self.facets - middle).sum()) < 0.0

    @cached_property
    def normals(self) -> FloatArray:
        """The outward unit normals (m, d) of the facets."""
        edges = self.facets[:, 1:] - self.facets[:, :1]
        if edges.shape[2] == 2:
            normals = edges[:, 0, ::-1] * np.array([1.0, -1.0])
        else:
            normals = np.cross(edges[:, 0], edges[:, 1])
        return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])

    @cached_property
    def _frames(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of the facets the first corners and normals (m, d), and what gives a way's shares."""
        start, edges = self.facets[:, 0], self.facets[:, 1:] - self.facets[:, :1]
        return start, self.normals, np.asarray(np.linalg.pinv(np.swapaxes(edges, 1, 2)))

    def way_out(self, x: FloatArray, towards: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where rays from points (d, k) inside first leave the foundation.

        ``towards`` (d, k) are the directions of the rays.  Returns the depth (k,) of each point
        below the facet that its ray leaves through, inf without one, and the outward normal (d, k)
        of this facet.
        """
        depths, ways = np.full(x.shape[1], np.inf), np.zeros(x.shape)
        for number, (place, ray) in enumerate(zip(x.T, towards.T, strict=True)):
            start, normals, to_shares = self._frames
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
                depths[number], ways[:, number] = depth[first], normals[first]
        return depths, ways


_Corners = Annotated[
    tuple[Annotated[tuple[Number, ...], Components(2)], ...],
    Field(min_length=2, max_length=_MOST_CORNERS),
    Tag(LIST),
]
_CornersOrFile = Annotated[
    _Corners | Annotated[File, Tag(TEXT)], list_or(TEXT), BeforeValidator(plain)
]


class Polyline(FacetedFoundation):
    """The signed distance to a polyline, positive on the right of the way along ``points`` (m, 2).

    The foundation is on the left, so that a closed outline runs counterclockwise around it.  The
    line is closed if its last corner is the first.  At a corner the sign is that of the mean of the
    normals of both segments, and beyond an open end that of the end's segment.  ``points`` are the
    corners, or a CSV file with the columns x and y.
    """

    key = "polyline"
    text = (
        "in 2D the corners of its outline, or a CSV file with the columns x and y; the rigid body "
        "is on the left when walking from corner to corner"
    )
    unit = "length"
    turn = "reverse the corners: the foundation is on the left when walking from one to the next"

    points: _CornersOrFile = entry(..., "the corners", "length", alias=ONLY)

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if body.dim != 2:
            yield Fault((), "is for 2D; in 3D use surface")

    @property
    def file(self) -> str | None:
        """The file with the corners, if they are in one."""
        return self.points if isinstance(self.points, str) else None

    def read(self, comm: MPI.Intracomm) -> Polyline:
        # A study file is read without MPI, and few shapes are those of files.
        from contact_locking.parallel import on_root
        from contact_locking.shapes.tool_files import read_corners

        line: Polyline = self
        if self.file is not None:
            path = Path(self.file)
            line = Polyline(on_root(comm, lambda: read_corners(path, _MOST_CORNERS)))
        if len(line.corners) < 2:
            raise InputError("has no segment: give at least two corners at different places")
        if (crossing := line.crossing()) is not None:
            first, second = crossing
            raise InputError(
                f"crosses or touches itself: segments {first + 1} and {second + 1} meet, so that "
                "it has no two sides"
            )
        return line

    @property
    def findings(self) -> list[Finding]:
        twice = len(self.points) - len(self.corners)
        return [Finding("foundation.double_corners", count=twice)] if twice else []

    @cached_property
    def corners(self) -> FloatArray:
        """The corners (m, 2), without those that are where the corner before is."""
        corners = np.array(self.points, dtype=float)
        kept = np.append(True, np.any(np.diff(corners, axis=0) != 0.0, axis=1))
        return np.asarray(corners[kept])

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
        places, segment, share = _nearest_on_segments(x.T, self.facets)
        beyond = (segment == 0) & (share == 0.0)
        beyond |= (segment == len(self.corners) - 2) & (share == 1.0)
        away = x.T - places
        # At the end itself, and straight above it, the line is met at a right angle.
        size = np.linalg.norm(away, axis=1)
        return np.asarray(beyond & (np.abs(_cross(away.T, self.normals[segment].T)) > 1e-9 * size))

    def crossing(self) -> tuple[int, int] | None:
        """The numbers of two segments that meet without being neighbours; None if no two do."""
        start, way = self.corners[:-1], np.diff(self.corners, axis=0)
        count, ends = len(start), np.stack([self.corners[:-1], self.corners[1:]])
        low, high = ends.min(axis=0), ends.max(axis=0)
        for first in range(count - 1):
            others = slice(first + 1, count)
            near = np.all((low[first] <= high[others]) & (high[first] >= low[others]), axis=1)
            other = first + 1 + np.flatnonzero(near)
            a, b, offset = way[first], way[other].T, (start[other] - start[first]).T
            follows = (other == first + 1) | (self.is_closed & (other - first == count - 1))
            # Of two neighbours one runs back along the other.
            folds = (_cross(a, b) == 0.0) & (a @ b < 0.0)
            meets = _cross(a, offset) * _cross(a, offset + b) <= 0.0
            meets &= _cross(b, -offset) * _cross(b, a[:, None] - offset) <= 0.0
            both = other[np.where(follows, folds, meets)]
            if len(both):
                return first, int(both[0])
        return None

    def _signed(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The distance (k,) and its gradient (2, k) at points (2, k)."""
        places, segment, share = _nearest_on_segments(x.T, self.facets)
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


class TriangulatedSurface(FacetedFoundation):
    """The signed distance to triangles in space, positive on the side of their normals.

    ``points`` (m, 3) are the corners, each once, and ``triangles`` (n, 3) are numbers of corners,
    counterclockwise seen from outside; or ``file`` has them.  VTK finds the nearest point, and the
    sign by the normal there: at an edge or a corner the mean of the normals, weighted by the angles
    of the triangles (Baerentzen and Aanaes, doi:10.1109/TVCG.2005.49).
    """

    key = "surface"
    text = "in 3D a surface of triangles or a height map; a text is its file"
    turn = "turn the triangles with surface: {file: ..., turned: true}"

    points: Any = hidden("points")
    triangles: Any = hidden("triangles")
    file: File | None = entry(
        None, "an STL file or a height map (.csv, .npy), relative to the study file"
    )
    spacing: tuple[Positive, Positive] | None = entry(
        None,
        "of a height map: the distances dx of its columns and dy of its rows",
        "length",
    )
    scale: Positive = entry(1.0, "factor of its coordinates, such as 0.001 from mm to m", "1")
    shift: Annotated[tuple[Number, ...], Components(3)] | None = entry(
        None, "added to its coordinates after scale; null: nothing", "length"
    )
    turned: Switch = entry(False, "whether the other side of the triangles is outside")

    @model_validator(mode="before")
    @classmethod
    def _from_value(cls, data: Any) -> Any:
        return {"file": data} if isinstance(data, str) else data

    def _faults(self) -> Iterator[Fault]:
        if (self.file is None) == (self.points is None):
            yield Fault(("file",), "is missing: give a file, or points and triangles in a script")

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if body.dim != 3:
            yield Fault((), "is for 3D; in 2D use polyline")

    def read(self, comm: MPI.Intracomm) -> TriangulatedSurface:
        from contact_locking.parallel import on_root
        from contact_locking.shapes.tool_files import read_surface

        if self.file is None:
            return self
        path, shift = Path(self.file), self.shift or (0.0, 0.0, 0.0)
        read = on_root(
            comm, lambda: read_surface(path, self.scale, shift, self.turned, self.spacing)
        )
        surface = TriangulatedSurface(*read[:2])
        surface.findings.extend(read[2])
        return surface

    @cached_property
    def findings(self) -> list[Finding]:
        return []

    @cached_property
    def _last(self) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
        """The last points with their results: callers ask for gap and normal after each other."""
        return []

    @property
    def facets(self) -> FloatArray:
        return np.asarray(self.points[self.triangles])

    def gap(self, x: FloatArray) -> FloatArray:
        return self._nearest(x)[0]

    def contact_normal(self, x: FloatArray) -> FloatArray:
        distance, places = self._nearest(x)
        step = _NEAR * self.extent
        near = np.abs(distance) <= step
        normals = (x - places) / np.where(near, 1.0, distance)
        for number in np.flatnonzero(near):
            places_around = x[:, number] + step * np.concatenate([np.eye(3), -np.eye(3)])
            around = np.array([self._distance.EvaluateFunction(place) for place in places_around])
            slope = around[:3] - around[3:]
            normals[:, number] = slope / np.linalg.norm(slope)
        return np.asarray(-normals)

    def sharp_points(self, box: FloatArray, spacing: float) -> FloatArray:
        middle, radius = box.mean(axis=0), 0.5 * float(np.linalg.norm(np.ptp(box, axis=0)))
        sharp = [self.points]
        for start, end in self.points[self._edges[1]]:
            length = float(np.linalg.norm(end - start))
            along = (end - start) / length
            foot = (middle - start) @ along
            low, high = np.clip([foot - radius, foot + radius], 0.0, length)
            if np.linalg.norm(start + np.clip(foot, 0.0, length) * along - middle) <= radius:
                count = int(np.ceil((high - low) / spacing)) + 1
                sharp.append(start + np.linspace(low, high, count)[:, None] * along)
        points = np.concatenate(sharp)
        return np.asarray(points[np.all((points >= box[0]) & (points <= box[1]), axis=1)])

    @cached_property
    def _edges(self) -> tuple[IntArray, IntArray]:
        """The edges (r, 2) of the rim, and those (e, 2) where normals differ by over 10 degrees."""
        sides = np.sort(self.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        order = np.lexsort(sides.T)
        sides, normals = sides[order], self.normals[order // 3]
        pairs = np.flatnonzero(np.all(sides[1:] == sides[:-1], axis=1))
        is_rim = np.ones(len(sides), dtype=bool)
        is_rim[pairs] = is_rim[pairs + 1] = False
        cosine = np.sum(normals[pairs] * normals[pairs + 1], axis=1)
        return sides[is_rim], sides[pairs[cosine < _SHARP]]

    def reversed(self) -> TriangulatedSurface:
        return TriangulatedSurface(self.points, self.triangles[:, ::-1])

    @property
    def is_closed(self) -> bool:
        return not len(self._edges[0])

    def at_open_end(self, x: FloatArray) -> BoolArray:
        if self.is_closed:
            return np.zeros(x.shape[1], dtype=bool)
        places = self._nearest(x)[1].T
        on_rim, _, _ = _nearest_on_segments(places, self.points[self._edges[0]])
        return np.asarray(np.linalg.norm(places - on_rim, axis=1) <= 1e-9 * self.extent)

    def _nearest(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The signed distance (k,), and the nearest place (3, k) of the surface."""
        if self._last and np.array_equal(self._last[0][0], x):
            return self._last[0][1:]
        distances, places = np.empty(x.shape[1]), np.empty((x.shape[1], 3))
        closest = [0.0, 0.0, 0.0]
        for number, point in enumerate(x.T):
            distances[number] = self._distance.EvaluateFunctionAndGetClosestPoint(point, closest)
            places[number] = closest
        self._last[:] = [(x.copy(), distances, places.T)]
        return distances, places.T

    @cached_property
    def _distance(self) -> Any:
        # VTK is needed for surfaces of triangles only, and its import takes long.
        try:
            from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
            from vtkmodules.vtkCommonCore import vtkPoints
            from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
            from vtkmodules.vtkFiltersCore import vtkImplicitPolyDataDistance
        except ImportError as error:
            raise InputError(f"distances from triangles need VTK: {_INSTALL} ({error})") from None

        corners, cells, surface = vtkPoints(), vtkCellArray(), vtkPolyData()
        corners.SetData(numpy_to_vtk(np.ascontiguousarray(self.points, dtype=float), deep=1))
        offsets = np.arange(0, self.triangles.size + 1, 3, dtype=np.int64)
        numbers = np.ascontiguousarray(self.triangles, dtype=np.int64).reshape(-1)
        cells.SetData(
            numpy_to_vtkIdTypeArray(offsets, deep=1), numpy_to_vtkIdTypeArray(numbers, deep=1)
        )
        surface.SetPoints(corners)
        surface.SetPolys(cells)
        distance = vtkImplicitPolyDataDistance()
        distance.SetInput(surface)
        return distance


def _nearest_on_segments(
    points: FloatArray, segments: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """The nearest places (k, d) to points (k, d) of segments (m, 2, d).

    Returns also the segment (k,) of each place, and its share (k,) of it.
    """
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    square = np.sum(along**2, axis=1)
    rows = max(_AT_ONCE // len(along), 1)
    numbers, nearest_shares = [], []
    for some in np.array_split(points, max(len(points) // rows, 1)):
        away = some[:, None] - start
        shares = np.clip(np.einsum("kmi,mi->km", away, along) / square, 0.0, 1.0)
        offset = away - shares[:, :, None] * along
        nearest = np.argmin(np.sum(offset**2, axis=2), axis=1)
        numbers.append(nearest)
        nearest_shares.append(shares[np.arange(len(some)), nearest])
    number, share = np.concatenate(numbers), np.concatenate(nearest_shares)
    return start[number] + share[:, None] * along[number], number, share


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[0] * b[1] - a[1] * b[0])
