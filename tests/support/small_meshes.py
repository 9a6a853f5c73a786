"""Meshes of some cells, sound ones and such as are no bodies, and what is said of them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from mpi4py import MPI
from msh import MeshElements, write_msh

from contact_locking.meshes import BUILDERS, Geometry
from contact_locking.study_file.parameters import Parameters

Points = list[tuple[float, ...]]
Groups = dict[str, MeshElements]

SQUARE: Points = [(0, 0), (1, 0), (1, 1), (0, 1)]
EDGES: Groups = {"bottom": [(1, 2)], "top": [(3, 4)], "left": [(4, 1)]}
BODY: Groups = {**EDGES, "body": [(1, 2, 3), (1, 3, 4)]}
FAR: Points = [(3, 0), (4, 0), (3, 1)]

# Two tetrahedra on either side of the triangle (1, 2, 3).
SPIRE: Points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1)]
TWO: Groups = {"left": [(1, 3, 4)], "body": [(1, 2, 3, 4), (1, 3, 2, 5)]}


def grid(x: float, y: float, first: int, n: int) -> tuple[Points, MeshElements]:
    """A unit square of n by n squares, two triangles each, whose points count from ``first``."""
    points: Points = [(x + i / n, y + j / n) for j in range(n + 1) for i in range(n + 1)]
    corners = [first + j * (n + 1) + i for j in range(n) for i in range(n)]
    up = [(c, c + 1, c + n + 2) for c in corners]
    return points, up + [(c, c + n + 2, c + n + 1) for c in corners]


def side_by_side(n: int, m: int, gap: float = 0.0) -> tuple[Points, Groups]:
    """Two grids that meet in x = 1 without shared nodes, as where fragment was forgotten."""
    one, left = grid(0, 0, 1, n)
    two, right = grid(1 + gap, 0, len(one) + 1, m)
    sides: Groups = {"left": [(1, n + 2)], "right": [(len(one) + m + 1, len(one) + 2 * m + 2)]}
    return one + two, {**sides, "one": left, "two": right}


def moved(points: Points, number: int, place: tuple[float, ...]) -> Points:
    return [place if i == number else point for i, point in enumerate(points, start=1)]


REFUSED: dict[str, tuple[Points, Groups, list[str]]] = {
    "a coordinate that is no number": (
        moved(SQUARE, 3, (math.nan, 1)),
        BODY,
        ["node 3 at (nan, 1)", "not finite numbers"],
    ),
    "an infinite coordinate": (moved(SQUARE, 2, (1, math.inf)), BODY, ["node 2 at (1, inf)"]),
    "three triangles on an edge": (
        [*SQUARE, (1.5, -0.5)],
        {**EDGES, "body": [(1, 2, 3), (1, 3, 4), (1, 3, 5)]},
        ["3 triangles share one edge", "nodes 1 and 3 at (0.5, 0.5)", "4, 5 and 6"],
    ),
    "three tetrahedra on a face": (
        [*SPIRE, (0.2, 0.2, 2)],
        {"left": [(1, 3, 4)], "body": [*TWO["body"], (1, 2, 3, 6)]},
        ["3 tetrahedra share one face", "nodes 1, 2 and 3", "2, 3 and 4"],
    ),
    "a triangle twice": (
        SQUARE,
        {**EDGES, "body": [(1, 2, 3), (2, 3, 1), (1, 3, 4)]},
        ["triangle 5 is triangle 4 once more, at (0.666667, 0.333333)"],
    ),
    "a tetrahedron twice": (
        SPIRE,
        {"left": [(1, 3, 4)], "body": [*TWO["body"], (4, 3, 2, 1)]},
        ["tetrahedron 4 is tetrahedron 2 once more"],
    ),
    "a triangle with a node twice": (
        SQUARE,
        {**EDGES, "body": [(1, 2, 3), (1, 3, 4), (1, 1, 2)]},
        ["triangle 6 at (0.333333, 0) has the same node twice"],
    ),
    "a triangle without area": (
        [*SQUARE, (1, 2)],
        {**EDGES, "body": [(1, 2, 3), (1, 3, 4), (2, 3, 5)]},
        ["triangle 6 at (1, 1) has collapsed", "one line"],
    ),
    "a tetrahedron without volume": (
        moved(SPIRE, 5, (0.6, 0.6, 0)),
        TWO,
        ["tetrahedron 3 at", "has collapsed", "one plane"],
    ),
    "a triangle turned over": (
        moved(SQUARE, 4, (0.8, 0.2)),
        BODY,
        ["triangle 4 at", "neighbour 5 overlap", "nodes 1 and 3"],
    ),
    "a tetrahedron turned over": (
        moved(SPIRE, 5, (0.1, 0.1, 0.5)),
        TWO,
        ["tetrahedron 2 at", "neighbour 3 overlap"],
    ),
    "two squares that share no nodes": (
        *side_by_side(2, 2),
        ["two parts of the body touch", "nodes 3 and 10 are both at (1, 0)", "fragment"],
    ),
    "two triangles that share no nodes": (
        [*SQUARE, (0, 0), (1, 1)],
        {**EDGES, "body": [(1, 2, 3), (5, 6, 4)]},
        ["two parts of the body touch", "nodes 1 and 5 are both at (0, 0), and 2 more"],
    ),
    "nodes that nearly are at one place": (
        [*SQUARE, (1e-7, 0), (1, 1 + 1e-7)],
        {**EDGES, "body": [(1, 2, 3), (5, 6, 4)]},
        ["two parts of the body touch", "nodes 1 and 5"],
    ),
    "a whole body twice": (
        SQUARE + SQUARE,
        {**BODY, "again": [(5, 6, 7), (5, 7, 8)]},
        ["two parts of the body touch", "and 6 more"],
    ),
    "a hanging node": (
        [*SQUARE, (0.5, 0.5)],
        {**EDGES, "body": [(1, 2, 3), (1, 5, 4), (5, 3, 4)]},
        ["node 5 at (0.5, 0.5) hangs", "edge of triangle 4 (nodes 1 and 3)"],
    ),
    "a hanging node in space": (
        [*SPIRE, (0.25, 0.25, 0)],
        {"left": [(1, 3, 4)], "body": [(1, 2, 3, 4), (1, 2, 6, 5), (2, 3, 6, 5), (3, 1, 6, 5)]},
        ["node 6 at (0.25, 0.25, 0) hangs", "face of tetrahedron 2 (nodes 1, 2 and 3)"],
    ),
    "a cell in no group": (
        SQUARE,
        {**EDGES, "body": [(1, 2, 3)], "": [(1, 3, 4)]},
        ["cells outside every group", "triangle 5 at (0.333333, 0.666667)"],
    ),
    "a node above the plane": (
        [(0, 0, 0), (1, 0, 0), (1, 1, 0.5), (0, 1, 0)],
        BODY,
        ["a surface in space", "node 1 has z = 0, node 3 z = 0.5"],
    ),
    "a name with commands for the terminal": (
        SQUARE,
        {**BODY, "\x1b[2J": [(2, 3)]},
        ["cannot be printed", r"'\x1b[2J'"],
    ),
    "triangles that share no nodes at all": (
        [(3 * i + x, y) for i in range(101) for x, y in SQUARE[:3]],
        {"body": [(3 * i + 1, 3 * i + 2, 3 * i + 3) for i in range(101)]},
        ["falls into 101 parts"],
    ),
}


def builder(name: str, **given: Any) -> Geometry:
    return BUILDERS[name](**given)


def study(path: Path, **changes: Any) -> Parameters:
    """The mesh, clamped on the left and pressed onto the ground."""
    data: dict[str, Any] = {
        "mesh": {"file": str(path)},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
        "loads": {"displacements": [{"on": "left", "value": [0, -0.01]}]},
        "contact": {"on": "bottom", "gap": 0.005},
        "friction": {"coefficient": 0, "smoothing": {"kernel": "none"}},
    }
    return Parameters.model_validate({**data, **changes})


def shared(comm: MPI.Intracomm, tmp_path: Path, points: Points, groups: Groups) -> Path:
    """A mesh file of rank 0 that all ranks read."""
    folder = Path(comm.bcast(str(tmp_path)))
    if comm.rank == 0:
        write_msh(folder / "body.msh", points, groups)
    comm.Barrier()
    return folder / "body.msh"


LOOSE: Groups = {**BODY, "island": [(5, 6, 7)], "shore": [(5, 6)], "coast": [(6, 7)]}
