"""Blocks of quadrilaterals and hexahedra that are no parallelograms, as Gmsh files."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from dolfinx import mesh as dmesh
from mpi4py import MPI
from msh import write_msh
from small_meshes import Groups, Points

from contact_locking.arrays import FloatArray
from contact_locking.mesh.parts import NamedFacets
from contact_locking.mesh.xdmf import export

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


def distorted(dim: int, parts: int, share: float = 0.25) -> tuple[Points, Groups]:
    """The unit square or cube of ``parts^d`` boxes with moved nodes, and its sides by name.

    Nodes move by up to the share of a box: along the sides that they lie on, and inside in every
    direction, so that faces inside are not plane.
    """
    rng = np.random.default_rng(1)
    lattice = np.array(list(itertools.product(range(parts + 1), repeat=dim)))
    number = {tuple(map(int, place)): i for i, place in enumerate(lattice, start=1)}

    def at(place: Any, corner: Any) -> int:
        return number[tuple(int(a + b) for a, b in zip(place, corner, strict=True))]

    steps = rng.uniform(-share, share, lattice.shape)
    steps[(lattice == 0) | (lattice == parts)] = 0.0
    points: Points = [tuple(map(float, row)) for row in (lattice + steps) / parts]
    groups: Groups = {}
    for axis, end in itertools.product(range(dim), (0, 1)):
        places = itertools.product(range(parts), repeat=dim - 1)
        groups[SIDES[dim][2 * axis + end]] = [
            tuple(
                at(_with(axis, end * parts, place), _with(axis, 0, corner))
                for corner in _CORNERS[dim - 1]
            )
            for place in places
        ]
    groups["body"] = [
        tuple(at(place, corner) for corner in _CORNERS[dim])
        for place in itertools.product(range(parts), repeat=dim)
    ]
    return points, groups


def _with(axis: int, value: int, others: tuple[int, ...]) -> tuple[int, ...]:
    return (*others[:axis], value, *others[axis:])


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
