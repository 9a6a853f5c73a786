"""Elements: their spaces, and the points where the laws hold, each with a weight.

All that depends on the element stands here.  An element is one more object :class:`Element`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import dolfinx
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

from contact_locking import _compat
from contact_locking.errors import InputError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]

#: A rule of integration, as the metadata of a measure; an empty one is exact for polynomials.
Rule = Mapping[str, Any]


@dataclass(frozen=True)
class Element:
    """Displacements, strains, and the points where the laws hold, on triangles and tetrahedra.

    Displacements are continuous and of degree ``degree`` in each cell.  Strains, stresses and
    limits are discontinuous and of degree ``strain_degree``, 0 or 1; their degrees of freedom are
    the values at the midpoint or at the corners of each cell.

    ``locking_rule`` is the rule for integrals of the locking limit over cells.  Its points have to
    be those of the strains, so that the limit holds at these points, with the rule's weights.
    ``contact_rule`` is the rule for integrals over Gamma_C.  Its points have to be the nodes of the
    displacement, so that contact and friction act node by node, and its weights positive.

    ``pieces`` says into which pieces, with d nodes each, the nodes of a facet divide the facet.
    The facet's nodes are numbered from 0, its corners first.  For a dimension d that is missing
    the element has no contact.
    """

    degree: int
    strain_degree: int
    locking_rule: Rule
    contact_rule: Rule
    pieces: Mapping[int, tuple[tuple[int, ...], ...]]

    def nodal_space(self, mesh: dolfinx.mesh.Mesh, size: int) -> fem.FunctionSpace:
        """Continuous fields of the displacement's degree with ``size`` components; collective."""
        return fem.functionspace(mesh, ("P", self.degree, (size,)))

    def displacement_space(self, mesh: dolfinx.mesh.Mesh) -> fem.FunctionSpace:
        """The displacements; collective."""
        return self.nodal_space(mesh, mesh.topology.dim)

    def strain_space(
        self, mesh: dolfinx.mesh.Mesh, shape: tuple[int, ...] = ()
    ) -> fem.FunctionSpace:
        """Strains, stresses and limits; ``shape`` is that of the values; collective."""
        return fem.functionspace(mesh, ("DG", self.strain_degree, shape))

    def strain_places(self, mesh: dolfinx.mesh.Mesh) -> FloatArray:
        """Where the strains have their points (d, k), cell after local cell, ghosts included."""
        dim = mesh.topology.dim
        index_map = mesh.topology.index_map(dim)
        cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        if self.strain_degree == 0:
            return np.asarray(dmesh.compute_midpoints(mesh, dim, cells)[:, :dim].T)
        corners = mesh.geometry.x[_compat.cell_nodes(mesh)[cells]]
        return np.asarray(corners.reshape(-1, 3)[:, :dim].T)

    def locking_dx(self, dx: ufl.Measure) -> ufl.Measure:
        """The measure ``dx`` with the rule of the locking limit."""
        return dx(metadata=dict(self.locking_rule)) if self.locking_rule else dx

    def facet_pieces(self, dim: int, key: str) -> IntArray:
        """:attr:`pieces` (m, d) in d dimensions.

        Raises InputError, with the key, where the element has no contact.
        """
        if dim not in self.pieces:
            raise InputError(
                f"there is no contact in {dim} dimensions for elements of degree {self.degree}; "
                "take elements of degree 1",
                key,
            )
        return np.array(self.pieces[dim], dtype=np.int32)

    def require_linear(self, what: str) -> None:
        """Raise InputError, in which ``what`` is the subject, unless displacements are affine."""
        if self.degree != 1:
            raise InputError(
                f"{what} are for linear elements; these elements have degree {self.degree}"
            )


_VERTICES: Rule = {"quadrature_rule": "vertex", "quadrature_degree": 1}

#: Affine displacements.  The strain is constant in a cell, so that the limit holds at one point of
#: the cell, and for an affine gap the condition at the nodes is the condition everywhere.
P1 = Element(
    degree=1,
    strain_degree=0,
    locking_rule={},
    contact_rule=_VERTICES,
    pieces={2: ((0, 1),), 3: ((0, 1, 2),)},
)

#: Quadratic displacements.  The strain is affine in a cell and the norm is convex: a constant limit
#: that is kept at the corners of a cell is kept everywhere in the cell.  The rule of the corners is
#: exact for affine integrands only, and Z : eps(v) is quadratic: where a smooth solution locks, the
#: rate in V is one, as for P1, with a smaller error.  On edges Simpson's rule, that of Gauss and
#: Lobatto with three points, has the nodes as points and positive weights.  On triangles no rule
#: has both, as the functions of the corners have the mean zero.
P2 = Element(
    degree=2,
    strain_degree=1,
    locking_rule=_VERTICES,
    contact_rule={"quadrature_rule": "GLL", "quadrature_degree": 3},
    pieces={2: ((0, 2), (2, 1))},
)
