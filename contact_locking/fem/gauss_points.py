"""The points of Gauss's rule of degree 2 in a cell, and functions of degree 1 given there.

A cell has as many points as corners: the functions are affine in a simplex, and of degree 1 in each
coordinate of a quadrilateral or a hexahedron.  Each point is next to the corner with its number.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import basix
import basix.ufl
import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.mesh.cell_kind import NAMED, lagrange, nodal_functions


@cache
def shares(cell: str) -> FloatArray:
    """The values (q, c) of the functions of a cell's corners, with a row for each point."""
    return nodal_functions(cell, 1, points(cell))


def element(cell: str, shape: tuple[int, ...] = ()) -> Any:
    """The element of discontinuous functions whose dofs are the values at the points.

    ``shape`` is the shape of the values, () for scalars.
    """
    scalars = _element(cell)
    return basix.ufl.blocked_element(scalars, shape=shape) if shape else scalars


def points(cell: str) -> FloatArray:
    """The points (q, d) of the rule in the reference cell."""
    found, _ = basix.make_quadrature(basix.CellType[cell], 2)
    apart = np.linalg.norm(lagrange(cell, 1).points[:, None] - found, axis=2)
    return np.asarray(found[np.argmin(apart, axis=1)])


@cache
def _element(cell: str) -> Any:
    kind, dim, places = basix.CellType[cell], NAMED[cell].dim, points(cell)
    number = len(places)
    # basix takes points and dual functionals for the entities of each of the dimensions 0 to 3.
    below = basix.topology(kind)[:dim]
    above: list[list[Any]] = [[]] * (3 - dim)
    no_points = [[np.zeros((0, dim))] * len(entities) for entities in below]
    no_functionals = [[np.zeros((0, 1, 0, 1))] * len(entities) for entities in below]
    return basix.ufl.custom_element(
        kind,
        (),
        np.eye(number),
        [*no_points, [places], *above],
        [*no_functionals, [np.eye(number).reshape(number, 1, number, 1)], *above],
        0,
        basix.MapType.identity,
        basix.SobolevSpace.L2,
        True,
        1,
        1,
    )
