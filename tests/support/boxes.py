"""Blocks of quadrilaterals and hexahedra that are no parallelograms, as Gmsh files."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from dolfinx import mesh as dmesh
from mpi4py import MPI
from msh import write_msh
from small_meshes import Groups, Points
from xdmf import export

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.mesh.parts import NamedFacets

# The corners of a quadrilateral and a hexahedron in Gmsh's order, as steps along the axes.
_CORNERS: dict[int, list[tuple[int, ...]]] = {
    1: [(0,), (1,)],
    2: [(0, 0), (1, 0), (1, 1), (0, 1)],
    3: [(i, j, k) for k in (0, 1) for i, j in [(0, 0), (1, 0), (1, 1), (0, 1)]],
}
SIDES = {
    2: ("left", "right", "bottom", "top"),
    3: ("left", "right", "front", "back", "bottom", "top"),
}


def lattice(counts: Sequence[int], kind: str = "box") -> tuple[IntArray, Groups]:
    """The places (n, d) of nodes, and the cells and sides of a block of so many boxes.

    With the kind "simplex" each box, and each side of one, is cut along its longest diagonal.
    """
    dim = len(counts)
    places = np.array(list(itertools.product(*(range(count + 1) for count in counts))))
    steps = np.array([math.prod(n + 1 for n in counts[axis + 1 :]) for axis in range(dim)])

    def pieces(spans: Sequence[Sequence[int]], axes: list[int]) -> list[tuple[int, ...]]:
        corners = np.array(_CORNERS[len(axes)]) @ steps[axes]
        ways = [corners]
        if kind == "simplex":
            orders = itertools.permutations(axes)
            ways = [np.append(0, np.cumsum(steps[list(order)])) for order in orders]
        starts = [1 + int(np.dot(corner, steps)) for corner in itertools.product(*spans)]
        return [tuple((start + way).tolist()) for start in starts for way in ways]

    whole = [range(count) for count in counts]
    groups: Groups = {}
    for axis, end in itertools.product(range(dim), (0, 1)):
        spans = [
            *whole[:axis],
            range(end * counts[axis], end * counts[axis] + 1),
            *whole[axis + 1 :],
        ]
        others = [other for other in range(dim) if other != axis]
        groups[SIDES[dim][2 * axis + end]] = pieces(spans, others)
    groups["body"] = pieces(whole, list(range(dim)))
    return places, groups


def distorted(dim: int, parts: int, share: float = 0.25) -> tuple[Points, Groups]:
    """The unit square or cube of ``parts^d`` boxes with moved nodes, and its sides by name.

    Nodes move by up to the share of a box: along the sides that they lie on, and inside in every
    direction, so that faces inside are not plane.
    """
    places, groups = lattice([parts] * dim)
    steps = np.random.default_rng(1).uniform(-share, share, places.shape)
    steps[(places == 0) | (places == parts)] = 0.0
    return [tuple(map(float, row)) for row in (places + steps) / parts], groups


def write_distorted(path: Path, dim: int, parts: int, share: float = 0.25) -> Path:
    """The mesh in a Gmsh file."""
    return write_msh(path, *distorted(dim, parts, share))


def write_lattice(
    path: Path, cells: tuple[int, int, int], at: Callable[[FloatArray], FloatArray]
) -> Path:
    """Hexahedra in a lattice of the unit cube, moved to ``at(x)`` (k, 3), in an XDMF file.

    The sides keep the names that they have in the cube.
    """
    kind = dmesh.CellType.hexahedron
    mesh = dmesh.create_box(MPI.COMM_SELF, [[0.0] * 3, [1.0] * 3], list(cells), kind)
    given = NamedFacets(mesh)
    for (axis, end), name in zip(itertools.product(range(3), (0.0, 1.0)), SIDES[3], strict=True):
        facets = dmesh.locate_entities_boundary(
            mesh, 2, lambda x, axis=axis, end=end: np.isclose(x[axis], end)
        )
        given.add(facets, name)
    mesh.geometry.x[:] = at(mesh.geometry.x)
    export(dataclasses.replace(given.domain(), cell_names={"body": 0}), path)
    return path
