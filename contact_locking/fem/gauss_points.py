"""The d + 1 points of Gauss's rule of degree 2 in a simplex, and affine functions given there.

The points are numbered as the corners: each point is next to the corner with its number.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import basix
import basix.ufl
import numpy as np

from contact_locking.arrays import FloatArray

SIMPLICES = {2: basix.CellType.triangle, 3: basix.CellType.tetrahedron}


def shares(dim: int) -> FloatArray:
    """The barycentric coordinates (d + 1, d + 1) of the points, with a row for each point."""
    points = _points(dim)
    return np.column_stack([1.0 - points.sum(axis=1), points])


def affine(dim: int, shape: tuple[int, ...] = ()) -> Any:
    """The element of discontinuous affine functions whose dofs are the values at the points.

    ``shape`` is the shape of the values, () for scalars.
    """
    element = _affine(dim)
    return basix.ufl.blocked_element(element, shape=shape) if shape else element


def _points(dim: int) -> FloatArray:
    """The points (d + 1, d) in the reference simplex."""
    cell = SIMPLICES[dim]
    points, _ = basix.make_quadrature(cell, 2)
    apart = np.linalg.norm(basix.geometry(cell)[:, None] - points, axis=2)
    return np.asarray(points[np.argmin(apart, axis=1)])


@cache
def _affine(dim: int) -> Any:
    cell, number = SIMPLICES[dim], dim + 1
    # basix takes points and dual functionals for the entities of each of the dimensions 0 to 3.
    points: list[list[Any]] = [[], [], [], []]
    functionals: list[list[Any]] = [[], [], [], []]
    for entity_dim, entities in enumerate(basix.topology(cell)[:dim]):
        points[entity_dim] = [np.zeros((0, dim))] * len(entities)
        functionals[entity_dim] = [np.zeros((0, 1, 0, 1))] * len(entities)
    points[dim] = [_points(dim)]
    functionals[dim] = [np.eye(number).reshape(number, 1, number, 1)]
    return basix.ufl.custom_element(
        cell,
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
