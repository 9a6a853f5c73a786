"""Lagrange's elements on the reference cells, and measures and normals of cells and facets."""

from __future__ import annotations

from functools import cache

import basix
import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.mesh.cell_kind import CellKind


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


def measures(kind: CellKind, corners: FloatArray) -> FloatArray:
    """The measures (k,) of cells with corners (k, c, d)."""
    slopes, weights = _slopes(kind)
    return np.abs(np.linalg.det(np.einsum("aqn,knd->kqda", slopes, corners))) @ weights


def mean_normals(kind: CellKind, corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The integrals of a normal (k, d) and of 1 (k,) over facets with corners (k, c, d)."""
    slopes, weights = _slopes(kind)
    along = np.einsum("aqn,knd->akqd", slopes, corners)
    if len(along) == 1:
        normals = np.stack([along[0][..., 1], -along[0][..., 0]], axis=-1)
    else:
        normals = np.cross(*along)
    return np.einsum("kqd,q->kd", normals, weights), np.linalg.norm(normals, axis=2) @ weights


def _slopes(kind: CellKind) -> tuple[FloatArray, FloatArray]:
    """The derivatives (dim, q, c) of the corners' functions at Gauss's points, and the weights."""
    rule = 1 if kind.is_simplex else 2
    points, weights = basix.make_quadrature(basix.CellType[kind.name], rule)
    return lagrange(kind.name, 1).tabulate(1, points)[1:, :, :, 0], np.asarray(weights)
