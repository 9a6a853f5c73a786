"""The discretisation: the elements, and the points at which the laws hold.

Displacements are continuous, and affine in each cell.  Strains are constant in each cell, so that
the locking law holds at one point of each cell.  The laws of contact and friction hold at the nodes
of Gamma_C, with the weights of the vertex rule.
"""

from __future__ import annotations

from typing import Any

import dolfinx
from dolfinx import fem

#: The degree of the displacement.
DEGREE = 1
#: The vertex rule: an integral over Gamma_C is a weighted sum of the values at the nodes.
CONTACT_RULE: dict[str, Any] = {"quadrature_rule": "vertex", "quadrature_degree": 1}


def nodal_space(mesh: dolfinx.mesh.Mesh, size: int) -> fem.FunctionSpace:
    """Continuous fields with ``size`` components, of the degree of the displacement; collective."""
    return fem.functionspace(mesh, ("P", DEGREE, (size,)))


def displacement_space(mesh: dolfinx.mesh.Mesh) -> fem.FunctionSpace:
    """The space of displacements; collective."""
    return nodal_space(mesh, mesh.topology.dim)


def strain_space(mesh: dolfinx.mesh.Mesh, shape: tuple[int, ...] = ()) -> fem.FunctionSpace:
    """The space of strains, stresses and limits: discontinuous, of one degree less; collective.

    ``shape`` is the shape of the values, () for scalars.
    """
    return fem.functionspace(mesh, ("DG", DEGREE - 1, shape))
