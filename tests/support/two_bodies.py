"""Two bodies that touch each other: blocks, rings and discs whose meshes do not match."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import basix.ufl
import numpy as np
from boxes import distorted
from dolfinx import mesh as dmesh
from mpi4py import MPI
from problems import with_changes
from small_meshes import Groups, Points, builder, shared

from contact_locking.mesh.readers import extract
from contact_locking.meshes import build
from contact_locking.study_file.parameters import Parameters

YOUNG, POISSON = 2.0, 0.3


def stack(dim: int = 2, h: float = 0.25, **changes: Any) -> Parameters:
    """Two blocks with unmatched meshes; the lower one rests on its bottom."""
    data: dict[str, Any] = {
        "mesh": {"builder": "stack", "dim": dim, "h": h},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}},
        "loads": {
            "displacements": [{"on": "bottom", "value": [0.0] * dim}],
            "tractions": [{"on": "top", "value": [0.0] * (dim - 1) + [-0.01]}],
        },
        "contact": {"on": "upper_bottom", "against": "lower_top"},
        "friction": {"coefficient": 0.0, "smoothing": {"kernel": "none"}},
        "penalty": {"n": math.inf},
    }
    return with_changes(data, **changes)


def fit(**changes: Any) -> Parameters:
    """A ring in a ring, in plane stress, which overlap by 0.01."""
    data: dict[str, Any] = {
        "mesh": {"builder": "disc_in_ring", "quarter": True, "hole": 0.5, "h": 0.08},
        "material": {
            "elasticity": {"young": 1.0, "poisson": 0.3},
            "regions": {"ring": {"elasticity": {"young": 3.0, "poisson": 0.2}}},
            "plane": "stress",
        },
        "loads": {
            "displacements": [
                {"on": "left", "value": [0.0, None]},
                {"on": "bottom", "value": [None, 0.0]},
            ]
        },
        "contact": {"on": "inner", "against": "rim", "gap": -0.01},
        "penalty": {"n": math.inf},
    }
    return with_changes(data, **changes)


def lame_pressure(overlap: float) -> float:
    """The pressure between the rings 0.5 < r < 1 and 1 < r < 2."""
    inner = ((1.0 + 0.25) / (1.0 - 0.25) - 0.3) / 1.0
    outer = ((4.0 + 1.0) / (4.0 - 1.0) + 0.2) / 3.0
    return overlap / (inner + outer)


def two_discs(
    radii: tuple[float, float],
    h: float,
    fine: float,
    quarter: bool = True,
    layers: tuple[float, float] | None = None,
) -> tuple[dmesh.Mesh, Any]:
    """Quarters or halves of discs that touch at the origin, and their facets by names; collective.

    The meshes of the upper and the lower disc do not match.  With the heights of the ``layers`` of
    both in z they are hexahedra up to z = 1, as are the facets at the ``ends`` of z.
    """
    cell, dim = ("triangle", 2) if layers is None else ("hexahedron", 3)

    def part(radius: float, fine: float, height: float) -> Any:
        kind = "simplex" if layers is None else "box"
        disc = builder("disc", radius=radius, quarter=quarter, h=h, h_contact=fine, cells=kind)
        with build(disc) as model:
            flat = extract(model, "disc")
        x, cells = flat.points, flat.cells.nodes
        if layers is None:
            return x, cells
        heights = np.linspace(0.0, 1.0, round(1.0 / height) + 1)
        planes = [np.column_stack([x, np.full(len(x), z)]) for z in heights]
        floors = [cells + len(x) * floor for floor in range(len(heights))]
        boxes = [np.hstack(pair) for pair in pairwise(floors)]
        return np.concatenate(planes), np.concatenate(boxes)

    comm = MPI.COMM_WORLD
    count = 3 if layers is None else 8
    points, cells = np.zeros((0, dim)), np.zeros((0, count), dtype=np.int64)
    if comm.rank == 0:
        heights = layers or (1.0, 1.0)
        upper, lower = part(radii[0], fine, heights[0]), part(radii[1], 0.7 * fine, heights[1])
        points = np.concatenate([upper[0], lower[0] * [1.0, -1.0, 1.0][:dim]])
        cells = np.concatenate([upper[1], lower[1] + len(upper[0])])
    element = basix.ufl.element("Lagrange", cell, 1, shape=(dim,))
    mesh = dmesh.create_mesh(comm=comm, cells=cells, x=points, e=element)
    of_cells = dmesh.compute_midpoints

    def on(marker: Any) -> Any:
        return dmesh.locate_entities_boundary(mesh, dim - 1, marker)

    def round_part(side: float, radius: float) -> Any:
        def inside(x: Any) -> Any:
            away = np.hypot(x[0], x[1] - side * radius)
            return (np.abs(away - radius) < 1e-6) & (side * x[1] < 0.2 * radius)

        facets = on(inside)
        middles = of_cells(mesh, dim - 1, facets)
        return facets[side * middles[:, 1] > 0.0]

    facets = {
        "top": on(lambda x: np.abs(x[1] - radii[0]) < 1e-9),
        "bottom": on(lambda x: np.abs(x[1] + radii[1]) < 1e-9),
        "axis": on(lambda x: np.abs(x[0]) < 1e-9),
        "upper": round_part(1.0, radii[0]),
        "lower": round_part(-1.0, radii[1]),
        "ends": on(lambda x: (dim == 3) & (np.abs(x[2] - 0.5) > 0.5 - 1e-9)),
    }
    return mesh, facets


def bent_boxes(comm: MPI.Intracomm, folder: Path, parts: tuple[int, int], slope: float) -> Path:
    """A mesh file of two cubes of moved boxes, one on the other, with the parts of :func:`stack`.

    The interface rises by ``slope`` along x; its facets are no parallelograms.
    """
    points: Points = []
    groups: Groups = {}
    for cube, n in enumerate(parts):
        own, named = distorted(3, n)
        x = np.array(own)
        up = x[:, 2] if cube == 0 else 1.0 - x[:, 2]
        x[:, 2] += cube + slope * (x[:, 0] - 0.5) * up
        for name, cells in named.items():
            below = {"body": "lower", "top": "lower_top"}.get(name, name)
            above = {"body": "upper", "top": "top"}.get(name, f"upper_{name}")
            numbers = [tuple(len(points) + node for node in cell) for cell in cells]
            groups[above if cube else below] = numbers
        points += [tuple(map(float, row)) for row in x]
    return shared(comm, folder, points, groups)
