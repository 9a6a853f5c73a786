"""Circles and spheres that hold the nodes of a curved side, for meshes that are refined later."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray

# A node at this share of the radius from the circle or sphere counts as a node of it.
_ON = 1e-9


@dataclass(frozen=True)
class Curved:
    """``|x - centre| = radius`` for all nodes that belong to every one of ``groups``.

    ``groups`` are names of boundary parts, or of the regions on both sides of an interface.  If
    ``level``, the nodes lie in the plane through the centre across the last axis as well: they lie
    on a circle in space.
    """

    groups: tuple[str, ...]
    centre: tuple[float, ...]
    radius: float
    level: bool = False

    def put(self, points: FloatArray, nodes: IntArray) -> None:
        """Move those ``nodes`` (k,) of ``points`` (m, d) onto the curve that are not on it yet."""
        offset = points[nodes] - np.array(self.centre)
        if self.level:
            offset[:, -1] = 0.0
        lengths = np.linalg.norm(offset, axis=1)
        there = self.centre + offset * (self.radius / lengths)[:, None]
        moved = np.linalg.norm(there - points[nodes], axis=1) > _ON * self.radius
        points[nodes[moved]] = there[moved]


def rounded(
    curves: tuple[Curved, ...], points: FloatArray, belongs: Callable[[str], BoolArray]
) -> FloatArray:
    """Copies of ``points`` (m, d), moved onto the curves that they belong to.

    ``belongs`` gives for the name of a group the mask (m,) of its nodes.
    """
    points = points.copy()
    # A curve where two sides meet comes before the sides.
    for curve in sorted(curves, key=lambda curve: -len(curve.groups)):
        nodes = np.flatnonzero(np.all([belongs(name) for name in curve.groups], axis=0))
        curve.put(points, nodes)
    return points
