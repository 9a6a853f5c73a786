"""Random bodies with an edge on a block: fillets, bevels, rounds, corners and overhangs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gmsh
import numpy as np
from gmsh_groups import read

from .case import Random, Study
from .elements import Mesh

Place = tuple[float, float]
# At an end of the flat part the block goes on, the upper body overhangs, or both end there.
_ENDS = ["on", "on", "on", "over", "over", "flush"]


@dataclass(frozen=True)
class Edge:
    """The end of the flat part: from there ``width`` outwards and ``height`` up.

    An arc has a ``radius``, and a bevel none.
    """

    kind: str
    width: float = 0.0
    height: float = 0.0
    radius: float = 0.0


@dataclass(frozen=True)
class Punch:
    """A mesh, a study without the mesh file and ``contact.on``, both sides, and words for it."""

    mesh: Mesh
    study: Study
    sides: tuple[str, str]
    words: str

    @property
    def is_pressed(self) -> bool:
        """Whether a pressure is given, and not a displacement."""
        return "pressures" in self.study["loads"]


def punch(seed: int, fineness: int = 1) -> Punch:
    """An upper body, whose flat part has the length (the radius) 1, pressed on a block.

    A problem has facets that are ``fineness`` times as short as its first ones.
    """
    random = Random.of(62, seed)
    axisymmetric = random.chance(0.4)
    right = _edge(random)
    left = Edge("axis") if axisymmetric else _edge(random)
    ends = [random.pick(_ENDS) for _ in range(2)]
    edges = [left, right]
    reach = [_reach(random, end, edge) for end, edge in zip(ends, edges, strict=True)]
    coarse = 1.0 / (fineness * int(random.integers(4, 11)))
    ratio = 3.0 ** random.between(-1.0, 1.0)
    sizes = [coarse / max(1.0, ratio), coarse * min(1.0, ratio)]
    heights = random.between(0.4, 1.2), random.between(0.5, 1.2)
    mesh = meshed(axisymmetric, (left, right), reach, sizes, heights)
    young, deep = [random.decades(-1.0, 1.0) for _ in range(2)], random.chance()
    load = random.pick(["moved", "moved", "pressed"])
    # Under a larger pressure bodies that overhang lean on an edge of the block and slide off.
    high = [-1.8, -1.2] if load == "moved" else [-2.2, -1.7]
    size = random.decades(*high) if deep else random.decades(-4.0, -2.0)
    friction = random.pick([0.0, 0.0, 0.1, 0.3])
    modulus = 1.0 / (1.0 / young[0] + 1.0 / young[1])
    loads: Study = {
        "displacements": [
            {"on": "base", "value": [0.0, 0.0]},
        ]
    }
    if load == "moved":
        loads["displacements"].append({"on": "top", "value": [0.0, -size]})
    if axisymmetric:
        loads["displacements"].append({"on": "axis", "value": [0.0, None]})
    if load == "pressed":
        loads["pressures"] = [{"on": "top", "value": modulus * size}]
        if not axisymmetric:
            # Guided, as a body whose load is beside its support would tilt.
            loads["displacements"].append({"on": "wall", "value": [0.0, None]})
    study: dict[str, Any] = {
        "mesh": {"axisymmetric": axisymmetric},
        "material": {
            "elasticity": {"young": young[0], "poisson": random.between(0.0, 0.4)},
            "regions": {
                "lower": {"elasticity": {"young": young[1], "poisson": random.between(0.0, 0.4)}}
            },
        },
        "loads": loads,
        "friction": {"coefficient": friction, "smoothing": {"kernel": "none"}},
        "penalty": {"n": math.inf},
        "discretisation": {"degree": random.pick([1, 2])},
    }
    side = random.pick(["sole", "sole", "flat"])
    words = (
        f"degree {study['discretisation']['degree']} {'axis' if axisymmetric else 'plane'} "
        f"{left.kind}/{right.kind} {'/'.join(ends)} {side} {load} {size:.2g} "
        f"facets {1.0 / sizes[0]:.1f}/{1.0 / sizes[1]:.1f} E {young[0] / young[1]:.2g}"
        f"{f' mu {friction}' if friction else ''}"
    )
    return Punch(mesh, study, (side, "face"), words)


def _edge(random: Random) -> Edge:
    kind = random.pick(["sharp", "fillet", "fillet", "bevel", "round"])
    if kind == "sharp":
        return Edge(kind)
    if kind == "fillet":
        radius = random.between(0.15, 0.6)
        return Edge(kind, radius, radius, radius)
    width = random.between(0.15, 0.5)
    if kind == "bevel":
        return Edge(kind, width, width * math.tan(math.radians(random.between(3.0, 50.0))))
    radius = random.between(1.0, 5.0)
    return Edge(kind, width, radius - math.sqrt(radius**2 - width**2), radius)


def _reach(random: Random, end: str, edge: Edge) -> float:
    """How far the block goes on beyond the end of the flat part."""
    if end == "flush":
        return 0.0
    return random.between(-0.25, -0.05) if end == "over" else edge.width + random.between(0.1, 1.5)


def meshed(
    axisymmetric: bool,
    edges: tuple[Edge, Edge],
    reach: Sequence[float],
    sizes: Sequence[float],
    heights: tuple[float, float],
) -> Mesh:
    """Linear triangles of both bodies, with the ``sizes`` of the facets of the upper and the lower.

    The block goes on by ``reach`` beyond both ends of the flat part, 0 < x < 1.
    """
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 0)
        gmsh.model.add("punch")
        _draw(axisymmetric, edges, reach, sizes, heights)
        gmsh.model.mesh.generate(2)
        points, regions, parts = read(gmsh.model, 2)
    finally:
        gmsh.finalize()
    cells = np.concatenate([regions["upper"], regions["lower"]])
    used, cells = np.unique(cells, return_inverse=True)
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    upper = len(regions["upper"])
    return Mesh(
        points[used, :2],
        cells.reshape(-1, 3),
        {name: number[facets] for name, facets in parts.items()},
        {"upper": np.arange(upper), "lower": np.arange(upper, len(cells.reshape(-1, 3)))},
        axisymmetric,
    )


def _draw(
    axisymmetric: bool,
    edges: tuple[Edge, Edge],
    reach: Sequence[float],
    sizes: Sequence[float],
    heights: tuple[float, float],
) -> None:
    geo = gmsh.model.geo
    left, right = edges
    top = heights[0] + max(edge.height for edge in edges)
    far = [max(3.0 * size, 0.3) for size in sizes]

    def line(places: list[Place], fine: int, side: int) -> list[int]:
        """A closed polygon, whose first places are fine; the tags of points."""
        return [
            geo.addPoint(x, y, 0.0, sizes[side] if n < fine else far[side])
            for n, (x, y) in enumerate(places)
        ]

    def profile(edge: Edge, start: int, x: float, way: float) -> tuple[int, list[int]]:
        """The end of the profile and its curve, from the end of the flat part."""
        if edge.width == 0.0:
            return start, []
        end = geo.addPoint(x + way * edge.width, edge.height, 0.0, sizes[0])
        if edge.radius == 0.0:
            return end, [geo.addLine(start, end)]
        return end, [geo.addCircleArc(start, geo.addPoint(x, edge.radius, 0.0), end)]

    a, b = line([(0.0, 0.0), (1.0, 0.0)], 2, 0)
    flat = geo.addLine(a, b)
    e, after = profile(right, b, 1.0, 1.0)
    s, before = profile(left, a, 0.0, -1.0)
    c, d = line([(1.0 + right.width, top), (-left.width, top)], 0, 0)
    walls = [geo.addLine(e, c), geo.addLine(c, d), geo.addLine(d, s)]
    upper = [flat, *after, *walls, *(-curve for curve in before)]
    low, high = 0.0 if axisymmetric else -reach[0], 1.0 + reach[1]
    corners = [(high, 0.0), (low, 0.0), (low, -heights[1]), (high, -heights[1])]
    tags = line(corners, 2, 1)
    lower = [geo.addLine(tags[i], tags[(i + 1) % 4]) for i in range(4)]
    faces = [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in (upper, lower)]
    geo.synchronize()
    groups = {
        "flat": [flat],
        "sole": [flat, *after, *before],
        "face": [lower[0]],
        "base": [lower[2]],
        "top": [walls[1]],
        "wall": [walls[0]],
    }
    if axisymmetric:
        groups["axis"] = [walls[2], lower[1]]
    for name, curves in groups.items():
        gmsh.model.addPhysicalGroup(1, curves, name=name)
    for name, face in zip(("upper", "lower"), faces, strict=True):
        gmsh.model.addPhysicalGroup(2, [face], name=name)
