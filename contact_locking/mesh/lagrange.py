"""Lagrange's elements on the reference cells: their nodes and the functions of these."""

from __future__ import annotations

from functools import cache

import basix
import numpy as np

from contact_locking.arrays import FloatArray


@cache
def lagrange(cell: str, degree: int) -> basix.finite_element.FiniteElement:
    """Lagrange's element of a degree on a cell or a facet, whose ``points`` are its nodes."""
    variant = basix.LagrangeVariant.gll_warped
    return basix.create_element(basix.ElementFamily.P, basix.CellType[cell], degree, variant)


def nodal_functions(cell: str, degree: int, points: FloatArray) -> FloatArray:
    """The values (q, n) of the functions of the nodes, in DOLFINx's order, at points (q, d)."""
    element = lagrange(cell, degree)
    if not len(points):
        # basix aborts without points.
        return np.zeros((0, element.dim))
    return np.asarray(element.tabulate(0, points)[0, :, :, 0])
