"""A flat punch with a round edge on a half space of the same material: Ciavarella's benchmark."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
from benchmark_bodies import friction
from mpi4py import MPI
from outlines import Side, graded, write_outlines
from small_meshes import Groups, Points, shared

from contact_locking.arrays import FloatArray

# Radii of the flat part, of the round edge and of the contact; bodies are cut at the distance FAR.
FLAT, ROUND, CONTACT, FAR = 10.0, 100.0, 10.0 / 0.7, 150.0
# The edge is round up to this radius, and the punch is flat again from there.
SHOULDER = 20.0
APPROACH, FORCE, MEAN = 0.321150, 446557.0, 696.504


def rounded_punch(folder: Path, fine: float) -> Path:
    """The half section, with facets of the size ``fine`` or a little smaller in the contact."""
    step = (SHOULDER, _height(SHOULDER))
    punch = [
        Side("sole", (0.0, 0.0)),
        Side("sole", (FLAT, 0.0), (FLAT, ROUND)),
        Side("", step),
        Side("far_upper", (FAR, step[1]), (0.0, step[1])),
        Side("axis", (0.0, FAR + step[1])),
    ]
    space = [
        Side("face", (0.0, 0.0)),
        Side("", (SHOULDER, 0.0)),
        Side("far_lower", (FAR, 0.0), (0.0, 0.0)),
        Side("axis", (0.0, -FAR)),
    ]
    size = graded([(CONTACT, 0.0), (FLAT, 0.0)], fine, 20.0, 4.0, FAR)
    return write_outlines(
        folder / "rounded.msh",
        {"upper": punch, "lower": space},
        lambda x: size(x) * (0.8 if x[1] < 0.0 else 1.0),
    )


def quarter_of_rounded_punch(folder: Path, cells: str, fine: float) -> Path:
    """A quarter in space, x, y > 0, as two blocks of hexahedra ("box") or tetrahedra."""
    points: Points = []
    groups: Groups = {}
    for name, up, size in (("upper", 1.0, fine), ("lower", -1.0, 0.8 * fine)):
        near = np.linspace(0.0, SHOULDER, round(SHOULDER / size) + 1)
        steps = np.cumsum(size * 1.45 ** np.arange(1, 30))
        away = steps[SHOULDER + steps < 0.8 * FAR]
        ticks = np.concatenate([near, SHOULDER + away, [FAR]])
        depth = np.concatenate([[0.0], steps[steps < 0.8 * FAR], [FAR]])
        _add_block(points, groups, name, (ticks, ticks, depth), up, cells)
    return shared(MPI.COMM_WORLD, folder, points, groups)


def _height(radius: float) -> float:
    away = min(max(radius, FLAT), SHOULDER) - FLAT
    return ROUND - math.sqrt(ROUND**2 - away**2)


def _add_block(
    points: Points,
    groups: Groups,
    name: str,
    ticks: tuple[FloatArray, FloatArray, FloatArray],
    up: float,
    cells: str,
) -> None:
    """A block over or under z = 0, whose sole is that of the punch if it is the upper one."""
    counts = [len(axis) for axis in ticks]
    first = len(points) + 1
    places = list(itertools.product(range(counts[2]), range(counts[1]), range(counts[0])))
    for k, j, i in places:
        x, y, z = float(ticks[0][i]), float(ticks[1][j]), float(ticks[2][k])
        lift = _height(math.hypot(x, y)) * (1.0 - z / FAR) if up > 0.0 else 0.0
        points.append((x, y, up * z + lift))
    steps = np.array([1, counts[0], counts[0] * counts[1]])

    def pieces(corner: tuple[int, ...], axes: tuple[int, ...]) -> list[tuple[int, ...]]:
        """A box of the grid, or a side of it, whole or as simplices on its longest diagonal."""
        start = first + int(np.dot(corner, steps))
        if cells == "simplex":
            orders = itertools.permutations(axes)
            return [(start, *(start + np.cumsum(steps[list(order)])).tolist()) for order in orders]
        one, other = steps[axes[0]], steps[axes[1]]
        ring = [start, start + one, start + one + other, start + other]
        above = [node + steps[axes[2]] for node in ring] if len(axes) == 3 else []
        return [tuple(int(node) for node in [*ring, *above])]

    def layer(axis: int, at: int) -> list[tuple[int, ...]]:
        axes = tuple(other for other in range(3) if other != axis)
        spans = [[at] if a == axis else range(counts[a] - 1) for a in range(3)]
        return [piece for corner in itertools.product(*spans) for piece in pieces(corner, axes)]

    spans = [range(count - 1) for count in counts]
    groups[name] = [
        piece for corner in itertools.product(*spans) for piece in pieces(corner, (0, 1, 2))
    ]
    groups["sole" if up > 0.0 else "face"] = layer(2, 0)
    groups[f"far_{name}"] = [facet for axis in range(3) for facet in layer(axis, counts[axis] - 1)]
    groups["left"] = [*groups.get("left", []), *layer(0, 0)]
    groups["front"] = [*groups.get("front", []), *layer(1, 0)]


def rounded_punch_study(path: Path, dim: int = 2) -> dict[str, Any]:
    """Far from the contact both bodies move as half spaces under a force at a point (Boussinesq).

    Between them is the approach of points that are infinitely far away.
    """
    young, poisson = 1e5, 0.3
    factor = FORCE * (1.0 + poisson) / (2.0 * math.pi * young)
    axes = "xyz"[:dim]
    deep = f"abs({axes[-1]})"
    # The expressions are evaluated at all nodes, at the origin too.
    away = f"max(sqrt({' + '.join(f'{axis}**2' for axis in axes)}), 1)"
    aside = f"{factor}*({deep}/{away}**3 - {1.0 - 2.0 * poisson}/({away}*({away} + {deep})))"
    along = f"{factor}*({deep}**2/{away}**3 + {2.0 * (1.0 - poisson)}/{away})"

    def far(up: float, offset: float) -> list[str]:
        return [*(f"{axis}*{aside}" for axis in axes[:-1]), f"{up}*{along} - {offset}"]

    held: list[tuple[str, list[Any]]] = [("axis", [0.0, None])]
    if dim == 3:
        held = [("left", [0.0, None, None]), ("front", [None, 0.0, None])]
    moved = [("far_lower", far(-1.0, 0.0)), ("far_upper", far(1.0, APPROACH))]
    return {
        "mesh": {"file": str(path), "axisymmetric": dim == 2},
        "material": {"elasticity": {"young": young, "poisson": poisson}},
        "loads": {"displacements": [{"on": on, "value": value} for on, value in held + moved]},
        "contact": {"on": "sole", "against": "face"},
        "friction": friction(0.0),
    }
