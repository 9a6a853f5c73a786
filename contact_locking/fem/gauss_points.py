"""The points of Gauss's rule of degree 2 in a cell, and functions given there.

A cell has as many points as corners, and the points are numbered as the corners: each point is next
to the corner with its number.  The functions are affine in a simplex, and of degree 1 in each
coordinate of a quadrilateral or a hexahedron.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import basix
import basix.ufl
import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.mesh.cell_kind import NAMED


@cache
def shares(cell: str) -> FloatArray:
    """The values (c, c) of the corners' functions of degree 1, with a row for each point."""
    return NAMED[cell].basis(_points(cell))


def element(cell: str, shape: tuple[int, ...] = ()) -> Any:
    """The element of discontinuous functions whose dofs are the values at the points.

    ``shape`` is the shape of the values, () for scalars.
    """
    scalars = _element(cell)
    return basix.ufl.blocked_element(scalars, shape=shape) if shape else scalars


def _points(cell: str) -> FloatArray:
    """The points (c, d) in the reference cell."""
    kind = basix.CellType[cell]
    points, _ = basix.make_quadrature(kind, 2)
    apart = np.linalg.norm(basix.geometry(kind)[:, None] - points, axis=2)
    return np.asarray(points[np.argmin(apart, axis=1)])


@cache
def _element(cell: str) -> Any:
    kind, dim, number = basix.CellType[cell], NAMED[cell].dim, NAMED[cell].corners
    # basix takes points and dual functionals for the entities of each of the dimensions 0 to 3.
    points: list[list[Any]] = [[], [], [], []]
    functionals: list[list[Any]] = [[], [], [], []]
    for entity_dim, entities in enumerate(basix.topology(kind)[:dim]):
        points[entity_dim] = [np.zeros((0, dim))] * len(entities)
        functionals[entity_dim] = [np.zeros((0, 1, 0, 1))] * len(entities)
    points[dim] = [_points(cell)]
    functionals[dim] = [np.eye(number).reshape(number, 1, number, 1)]
    return basix.ufl.custom_element(
        kind,
        (),
        np.eye(number),
        points,
        functionals,
        0,
        basix.MapType.identity,
        basix.SobolevSpace.L2,
        True,
        1,
        1,
    )
