"""Lagrange's elements on the reference cells, and the maps of curved cells, of degree 2."""

from __future__ import annotations

from functools import cache

import basix
import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.mesh.cell_kind import CellKind

# The Jacobian has the degree 2 in triangles and 3 in other cells.  It is looked at on a lattice of
# this degree.
_LATTICE = 6
# By the degree of the sides, rules for measures that are exact for cells.  For curved facets they
# are so to many digits.
_DEGREE = {1: 2, 2: 8}


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


def curved_jacobians(kind: CellKind, nodes: FloatArray) -> FloatArray:
    """The Jacobians (k, q) on a lattice of points of cells with nodes (k, n, d)."""
    lattice = basix.create_lattice(
        basix.CellType[kind.name], _LATTICE, basix.LatticeType.equispaced, True
    )
    slopes = lagrange(kind.name, 2).tabulate(1, lattice)[1:, :, :, 0]
    return np.asarray(np.linalg.det(np.einsum("aqn,knd->kqda", slopes, nodes)))


def measures(kind: CellKind, nodes: FloatArray) -> FloatArray:
    """The measures (k,) of cells with nodes (k, n, d)."""
    slopes, weights = _slopes(kind, nodes)
    return np.abs(np.linalg.det(np.einsum("aqn,knd->kqda", slopes, nodes))) @ weights


def mean_normals(kind: CellKind, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The integrals of a normal (k, d) and of 1 (k,) over facets with nodes (k, n, d)."""
    slopes, weights = _slopes(kind, nodes)
    normals = _normals(slopes, nodes)
    return np.einsum("kqd,q->kd", normals, weights), np.linalg.norm(normals, axis=2) @ weights


def normals_at_nodes(kind: CellKind, nodes: FloatArray) -> FloatArray:
    """Unit normals (k, n, d) of curved facets at their nodes (k, n, d)."""
    element = lagrange(kind.name, 2)
    normals = _normals(element.tabulate(1, element.points)[1:, :, :, 0], nodes)
    return np.asarray(normals / np.linalg.norm(normals, axis=2, keepdims=True))


def _normals(slopes: FloatArray, nodes: FloatArray) -> FloatArray:
    """Normals (k, q, d) whose lengths are the Jacobians, for derivatives (d - 1, q, n)."""
    along = np.einsum("aqn,knd->akqd", slopes, nodes)
    if len(along) == 1:
        return np.stack([along[0][..., 1], -along[0][..., 0]], axis=-1)
    return np.asarray(np.cross(*along))


def _slopes(kind: CellKind, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The derivatives (dim, q, n) of the nodes' functions at Gauss's points, and their weights."""
    degree = 1 if nodes.shape[1] == kind.corners else 2
    rule = 1 if degree == 1 and kind.is_simplex else _DEGREE[degree]
    points, weights = basix.make_quadrature(basix.CellType[kind.name], rule)
    return lagrange(kind.name, degree).tabulate(1, points)[1:, :, :, 0], np.asarray(weights)
