"""Shapes as from a CAD program, as triangles (n, 3, 3), each with its lowest points at z = 0."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from tool_files import box

from contact_locking.arrays import FloatArray

Polygon = Sequence[tuple[float, float]]


def _ears(corners: FloatArray) -> list[tuple[int, int, int]]:
    """The triangles of a polygon (m, 2) that runs counterclockwise, one ear after the other."""

    def turn(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
        return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))

    left, found = list(range(len(corners))), []
    while len(left) > 3:
        for place in range(len(left)):
            i, j, k = left[place - 1], left[place], left[(place + 1) % len(left)]
            a, b, c = corners[[i, j, k]]
            others = corners[[n for n in left if n not in (i, j, k)]]
            inside = [min(turn(a, b, p), turn(b, c, p), turn(c, a, p)) >= 0.0 for p in others]
            if turn(a, b, c) > 1e-12 and not any(inside):
                found.append((i, j, k))
                left.pop(place)
                break
    return [*found, (left[0], left[1], left[2])]


def prism(outline: Polygon, height: float = 0.5) -> FloatArray:
    """The polygon, counterclockwise, between z = 0 and a height."""
    corners = np.array(outline, dtype=float)
    low = np.c_[corners, np.zeros(len(corners))]
    high = low + np.array([0.0, 0.0, height])
    found = [low[[i, k, j]] for i, j, k in _ears(corners)]
    found += [high[[i, j, k]] for i, j, k in _ears(corners)]
    for a, b, c, d in zip(low, np.roll(low, -1, 0), np.roll(high, -1, 0), high, strict=True):
        found += [np.array([a, b, c]), np.array([a, c, d])]
    return np.array(found)


def lying(outline: Polygon, width: float = 0.6) -> FloatArray:
    """The polygon in the plane of x and z, counterclockwise seen from -y, of a width along y."""
    flat = prism(outline, width)
    return np.stack([flat[..., 0], width / 2 - flat[..., 2], flat[..., 1]], axis=-1)


def turned(profile: Polygon, sides: int = 24, closed: bool = False) -> FloatArray:
    """The profile of r and z turned about the z axis, with the tool on the left of its way."""
    angles = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    ends = [*profile, profile[0]] if closed else list(profile)
    found = []
    for (r, z), (s, y) in itertools.pairwise(ends):
        for one, other in itertools.pairwise(angles):
            a, b = ([r * math.cos(t), r * math.sin(t), z] for t in (one, other))
            c, d = ([s * math.cos(t), s * math.sin(t), y] for t in (other, one))
            found += [[a, b, c]] * (r > 0.0) + [[a, c, d]] * (s > 0.0)
    places = np.array(found)
    # The last meridian is the first one.
    places[np.abs(places) < 1e-14] = 0.0
    return np.asarray(np.round(places, 12))


def _arc(radius: float, first: float, last: float, count: int = 12) -> list[tuple[float, float]]:
    angles = np.radians(np.linspace(first, last, count + 1))
    return [(radius * math.cos(a), radius * math.sin(a)) for a in angles]


def _star() -> list[tuple[float, float]]:
    angles = np.radians(36.0 * np.arange(10))
    return [
        (r * math.cos(a), r * math.sin(a)) for r, a in zip([0.4, 0.16] * 5, angles, strict=True)
    ]


def _holed() -> FloatArray:
    outer = np.array([[-0.35, -0.35], [0.35, -0.35], [0.35, 0.35], [-0.35, 0.35]])
    found = []
    for i in range(4):
        a, b = outer[i], outer[(i + 1) % 4]
        for z, order in ((0.0, (0, 3, 2, 1)), (0.5, (0, 1, 2, 3))):
            quad = np.c_[[a, b, 0.5 * b, 0.5 * a], [z] * 4][list(order)]
            found += [quad[[0, 1, 2]], quad[[0, 2, 3]]]
        for p, q in ((a, b), (0.5 * b, 0.5 * a)):
            wall = np.array([[*p, 0.0], [*q, 0.0], [*q, 0.5], [*p, 0.5]])
            found += [wall[[0, 1, 2]], wall[[0, 2, 3]]]
    return np.array(found)


def _teeth(count: int, width: float, height: float = 0.2) -> list[tuple[float, float]]:
    pitch = 0.8 / count
    low = [(-0.4 + pitch * (i + share), z) for i in range(count) for share, z in (
        (0.0, height), (0.5 - width / 2, 0.0), (0.5 + width / 2, 0.0))]  # fmt: skip
    return [*low, (0.4, height), (0.4, 0.5), (-0.4, 0.5)]


_DOWN = [(0.0, 0.0), *((r, 0.4 + z) for r, z in _arc(0.4, -90.0, 0.0, 8)[1:])]
_SQUARE = [(-0.3, -0.3), (0.3, -0.3), (0.3, 0.3), (-0.3, 0.3)]
_RING = [(0.3 + r, 0.1 + z) for r, z in _arc(0.1, -90.0, 247.5, 15)]

SHAPES: dict[str, FloatArray] = {
    "star": prism(_star()),
    "half ring": prism([*_arc(0.4, 0.0, 180.0), *_arc(0.2, 180.0, 0.0)]),
    "crescent": prism([*_arc(0.4, -120.0, 120.0),
                       *((x - 0.15, y) for x, y in _arc(0.35, 100.0, -100.0))]),
    "angle block": prism([(-0.3, -0.3), (0.3, -0.3), (0.3, -0.1), (-0.1, -0.1), (-0.1, 0.3),
                          (-0.3, 0.3)]),
    "cylinder": turned([(0.0, 0.0), (0.3, 0.0), (0.3, 0.5), (0.0, 0.5)]),
    "cube": prism(_SQUARE),
    "cube with a hole": _holed(),
    "two shells": np.concatenate(
        [box([-0.35, -0.3, 0.0], [-0.1, 0.3, 0.5]), box([0.1, -0.3, 0.0], [0.35, 0.3, 0.5])]
    ),
    "wedge": lying([(0.0, 0.0), (0.3, 0.3), (-0.3, 0.3)]),
    "cone": turned([(0.0, 0.0), (0.4, 0.25), (0.0, 0.25)]),
    "torus": turned(_RING, closed=True),
    "T": prism([(-0.1, -0.3), (0.1, -0.3), (0.1, 0.1), (0.3, 0.1), (0.3, 0.3),
                (-0.3, 0.3), (-0.3, 0.1), (-0.1, 0.1)]),
    "U": prism([(-0.3, -0.3), (0.3, -0.3), (0.3, 0.3), (0.1, 0.3), (0.1, -0.1),
                (-0.1, -0.1), (-0.1, 0.3), (-0.3, 0.3)]),
    "cross": prism([(-0.1, -0.3), (0.1, -0.3), (0.1, -0.1), (0.3, -0.1), (0.3, 0.1), (0.1, 0.1),
                    (0.1, 0.3), (-0.1, 0.3), (-0.1, 0.1), (-0.3, 0.1), (-0.3, -0.1), (-0.1, -0.1)]),
    "hexagonal prism": prism(_arc(0.35, 0.0, 300.0, 5)),
    "pyramid": turned([(0.0, 0.0), (0.4, 0.2), (0.0, 0.2)], sides=4),
    "dumbbell": lying([(-0.4, 0.0), (-0.2, 0.0), (-0.2, 0.2), (0.2, 0.2), (0.2, 0.0), (0.4, 0.0),
                       (0.4, 0.5), (-0.4, 0.5)]),
    "bowl": turned([(0.2, 0.0), (0.4, 0.0), (0.4, 0.5), (0.0, 0.5), (0.0, 0.2)], closed=True),
    "hemisphere": turned([*_DOWN, (0.0, 0.4)]),
    "frustum": turned([(0.0, 0.0), (0.2, 0.0), (0.4, 0.4), (0.0, 0.4)]),
    "plate with teeth": lying(_teeth(5, 0.08)),
    "plate with a needle": lying(_teeth(1, 0.01)),
}  # fmt: skip
