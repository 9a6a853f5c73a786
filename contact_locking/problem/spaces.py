"""The discretisation, in one place: elements, and the points where the laws hold.

Displacements are continuous and affine in each cell.  Strains are constant in each cell, so that
the locking limit holds at one point of each cell.  Contact and friction hold at the nodes of
Gamma_C, with the weights of the vertex rule.
"""

from __future__ import annotations

from typing import Any

import dolfinx
from dolfinx import fem

#: The degree of the displacement.
DEGREE = 1
#: How integrals over Gamma_C are taken: by the values at the nodes.
CONTACT_RULE: dict[str, Any] = {"quadrature_rule": "vertex", "quadrature_degree": 1}


def nodal_space(mesh: dolfinx.mesh.Mesh, size: int) -> fem.FunctionSpace:
    """Continuous fields of the displacement's degree with ``size`` components; collective."""
    return fem.functionspace(mesh, ("P", DEGREE, (size,)))


def displacement_space(mesh: dolfinx.mesh.Mesh) -> fem.FunctionSpace:
    """The displacements; collective."""
    return nodal_space(mesh, mesh.topology.dim)


def strain_space(mesh: dolfinx.mesh.Mesh, shape: tuple[int, ...] = ()) -> fem.FunctionSpace:
    """Strains, stresses and limits: discontinuous, of one degree less; collective.

    ``shape`` is that of the values, () for scalars.
    """
    return fem.functionspace(mesh, ("DG", DEGREE - 1, shape))
