"""A rigid foundation in space whose surface consists of triangles."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.laws.faceted import FacetedFoundation, nearest_on_segments

_INSTALL = "apt-get install python3-vtk9, or pip install vtk"
# Nearer to the surface than this share of its size, the direction to the nearest point is rounding,
# and differences of the distance give the normal.
_NEAR = 1e-6
# The cosine of the angle between the normals beside a sharp edge, 10 degrees.
_SHARP = 0.985


class TriangulatedSurface(FacetedFoundation):
    """The signed distance to triangles in space, positive on the side of their normals.

    ``points`` (m, 3) are the corners, each once, and ``triangles`` (n, 3) are numbers of corners,
    counterclockwise seen from outside.  VTK finds the nearest point, and the sign by the normal
    there: at an edge or a corner the mean of the normals, weighted by the angles of the triangles
    (Baerentzen and Aanaes, doi:10.1109/TVCG.2005.49).
    """

    def __init__(self, points: FloatArray, triangles: IntArray) -> None:
        self.points, self.triangles = points, triangles
        self._size = float(np.ptp(points, axis=0).max())
        # The last points with their results: callers ask for gap and normal one after the other.
        self._last: tuple[FloatArray, FloatArray, FloatArray] | None = None

    @property
    def facets(self) -> FloatArray:
        return np.asarray(self.points[self.triangles])

    def gap(self, x: FloatArray) -> FloatArray:
        return self._nearest(x)[0]

    def contact_normal(self, x: FloatArray) -> FloatArray:
        distance, places = self._nearest(x)
        step = _NEAR * self._size
        near = np.abs(distance) <= step
        normals = (x - places) / np.where(near, 1.0, distance)
        for number in np.flatnonzero(near):
            places_around = x[:, number] + step * np.concatenate([np.eye(3), -np.eye(3)])
            around = np.array([self._distance.EvaluateFunction(place) for place in places_around])
            slope = around[:3] - around[3:]
            normals[:, number] = slope / np.linalg.norm(slope)
        return np.asarray(-normals)

    def sharp_points(self, box: FloatArray, spacing: float) -> FloatArray:
        inside = np.all((self.points >= box[0]) & (self.points <= box[1]), axis=1)
        found = [self.points[inside]]
        start, end = self.points[self._sharp_edges].transpose(1, 0, 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            ways = np.sort((box[:, None] - start) / (end - start), axis=0)
        # Along a side of the box an edge is within the box for all of its length or for nothing.
        between = (start >= box[0]) & (start <= box[1])
        never, always = np.array([np.inf, -np.inf])[:, None, None], np.array([0.0, 1.0])
        ways = np.where(start == end, np.where(between, always[:, None, None], never), ways)
        first = np.maximum(ways[0].max(axis=1, initial=0.0), 0.0)
        last = np.minimum(ways[1].min(axis=1, initial=1.0), 1.0)
        for a, b, low, high in zip(start, end, first, last, strict=True):
            if low < high:
                length = float(np.linalg.norm(b - a)) * (high - low)
                shares = np.linspace(low, high, int(np.ceil(length / spacing)) + 1)
                found.append(a + shares[:, None] * (b - a))
        return np.concatenate(found)

    @cached_property
    def _sharp_edges(self) -> IntArray:
        """The edges (e, 2) between triangles whose normals differ by more than 10 degrees."""
        normals = self.normals
        sides = np.sort(self.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        order = np.lexsort(sides.T)
        sides, owner = sides[order], order // 3
        pairs = np.flatnonzero(np.all(sides[1:] == sides[:-1], axis=1))
        cosine = np.sum(normals[owner[pairs]] * normals[owner[pairs + 1]], axis=1)
        return np.asarray(sides[pairs[cosine < _SHARP]])

    def reversed(self) -> TriangulatedSurface:
        return TriangulatedSurface(self.points, self.triangles[:, ::-1])

    @cached_property
    def rim(self) -> IntArray:
        """The edges (r, 2) of one triangle only, as numbers of corners."""
        edges = np.sort(self.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        found, counts = np.unique(edges, axis=0, return_counts=True)
        return np.asarray(found[counts == 1])

    @property
    def is_closed(self) -> bool:
        return not len(self.rim)

    def at_open_end(self, x: FloatArray) -> BoolArray:
        if self.is_closed:
            return np.zeros(x.shape[1], dtype=bool)
        places = self._nearest(x)[1].T
        on_rim, _, _ = nearest_on_segments(places, self.points[self.rim])
        return np.asarray(np.linalg.norm(places - on_rim, axis=1) <= 1e-9 * self._size)

    def _nearest(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The signed distance (k,), and the nearest place (3, k) of the surface."""
        if self._last is not None and np.array_equal(self._last[0], x):
            return self._last[1:]
        distances, places = np.empty(x.shape[1]), np.empty((x.shape[1], 3))
        found = [0.0, 0.0, 0.0]
        for number, point in enumerate(x.T):
            distances[number] = self._distance.EvaluateFunctionAndGetClosestPoint(point, found)
            places[number] = found
        self._last = x.copy(), distances, places.T
        return self._last[1:]

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
