"""The maps of curved cells, which are simplices of degree 2, from the reference cell."""

from __future__ import annotations

from functools import cache
from typing import Any

import basix
import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.mesh.cell_kind import CellKind

# The Jacobian has the degree 2 in 2D and 3 in 3D.  It is looked at on a lattice of this degree.
_LATTICE = 6


def node_shares(cell: str, degree: int, points: FloatArray) -> FloatArray:
    """The values (q, n) of the functions of the nodes of a cell at points (q, d).

    The nodes are those of Lagrange's element of the ``degree``, in the order of DOLFINx.
    """
    return np.asarray(_lagrange(cell, degree).tabulate(0, points)[0, :, :, 0])


def curved_jacobians(kind: CellKind, nodes: FloatArray) -> FloatArray:
    """The Jacobians (k, q) on a lattice of points of cells with nodes (k, n, d)."""
    lattice = basix.create_lattice(
        basix.CellType[kind.name], _LATTICE, basix.LatticeType.equispaced, True
    )
    slopes = _lagrange(kind.name, 2).tabulate(1, lattice)[1:, :, :, 0]
    return np.asarray(np.linalg.det(np.einsum("aqn,knd->kqda", slopes, nodes)))


@cache
def _lagrange(cell: str, degree: int) -> Any:
    variant = basix.LagrangeVariant.gll_warped
    return basix.create_element(basix.ElementFamily.P, basix.CellType[cell], degree, variant)
