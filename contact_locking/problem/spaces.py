"""Elements: the spaces of the discretisation, and the points, with weights, at which the laws hold.

All that depends on the element is here, so that another element is another :class:`Element`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

from contact_locking import _compat
from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.parameters import DiscretisationParameters
from contact_locking.problem import gauss_points

#: A quadrature rule as the metadata of a measure; the empty rule is exact for polynomials.
Rule = Mapping[str, Any]


@dataclass(frozen=True)
class Element:
    """Displacements, strains, and the points of the laws, on triangles and tetrahedra.

    Displacements are continuous and of degree ``degree`` in each cell.  Strains, stresses and
    limits are discontinuous and of degree ``strain_degree``, 0 or 1.  Their degrees of freedom are
    the values at the midpoint of each cell for degree 0.  For degree 1 they are the values at d + 1
    points, one beside each corner in the order of the corners: with ``limit_at`` "vertices" the
    corners themselves, with "gauss" the points of Gauss's rule of degree 2.

    The points of ``locking_rule``, the rule for integrals of the locking law over the cells, must
    be the points of the strains: the limit then holds at these points, with the weights of the
    rule.  The points of ``contact_rule``, the rule for integrals over Gamma_C, must be the nodes of
    the displacement, and the weights must be positive: contact and friction then act at the nodes.
    ``elastic_rule`` is the rule for integrals of the elastic stress; the empty rule is exact for
    elastic coefficients that are affine in a cell.

    ``pieces`` maps the dimension d to the pieces of a facet, each with d nodes of the facet.  The
    nodes of a facet are numbered from 0, with the corners first.  The element has no contact in a
    dimension without an entry.
    """

    degree: int
    strain_degree: int
    locking_rule: Rule
    contact_rule: Rule
    pieces: Mapping[int, tuple[tuple[int, ...], ...]]
    limit_at: str = "vertices"
    elastic_rule: Rule = field(default_factory=dict)

    def __str__(self) -> str:
        """The element in words."""
        where = {"vertices": "the vertices", "gauss": "the Gauss points"}[self.limit_at]
        if self.strain_degree == 0:
            return f"degree {self.degree}"
        return f"degree {self.degree}, the locking limit at {where} of each cell"

    def facts(self) -> dict[str, Any]:
        """The keys of the study file that choose the element."""
        return {"degree": self.degree, "limit_at": self.limit_at}

    def nodal_space(self, mesh: dolfinx.mesh.Mesh, size: int) -> fem.FunctionSpace:
        """Continuous fields of the displacement's degree with ``size`` components; collective."""
        return fem.functionspace(mesh, ("P", self.degree, (size,)))

    def displacement_space(self, mesh: dolfinx.mesh.Mesh) -> fem.FunctionSpace:
        """The space of displacements; collective."""
        return self.nodal_space(mesh, mesh.topology.dim)

    def strain_space(
        self, mesh: dolfinx.mesh.Mesh, shape: tuple[int, ...] = ()
    ) -> fem.FunctionSpace:
        """The space of strains, stresses and limits; collective.

        ``shape`` is the shape of the values, () for scalars.
        """
        if self.strain_degree == 0 or self.limit_at == "vertices":
            return fem.functionspace(mesh, ("DG", self.strain_degree, shape))
        return fem.functionspace(mesh, gauss_points.affine(mesh.topology.dim, shape))

    def strain_places(self, mesh: dolfinx.mesh.Mesh) -> FloatArray:
        """The coordinates (d, k) of the points of the strains, local cell by local cell.

        Ghost cells are included.
        """
        dim = mesh.topology.dim
        index_map = mesh.topology.index_map(dim)
        cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        if self.strain_degree == 0:
            return np.asarray(dmesh.compute_midpoints(mesh, dim, cells)[:, :dim].T)
        corners = mesh.geometry.x[_compat.cell_nodes(mesh)[cells]][:, :, :dim]
        if self.limit_at == "gauss":
            corners = np.einsum("pc,kcd->kpd", gauss_points.shares(dim), corners)
        return np.asarray(corners.reshape(-1, dim).T)

    @property
    def at_peaks(self) -> Element:
        """The element with strains at points where |eps(u)| is largest in each cell.

        A convex function of an affine strain is largest at a corner.  This is the element itself if
        its strain is constant in a cell or has its points at the corners.
        """
        if self.degree == 1 or (self.strain_degree == 1 and self.limit_at == "vertices"):
            return self
        return replace(self, strain_degree=1, limit_at="vertices")

    def locking_dx(self, dx: ufl.Measure) -> ufl.Measure:
        """The measure ``dx`` with the locking rule."""
        return _with_rule(dx, self.locking_rule)

    def elastic_dx(self, dx: ufl.Measure) -> ufl.Measure:
        """The measure ``dx`` with the elastic rule."""
        return _with_rule(dx, self.elastic_rule)

    def facet_pieces(self, dim: int, key: str) -> IndexArray:
        """The pieces (m, d) of a facet in d dimensions.

        Raises InputError with the key if the element has no contact in d dimensions.
        """
        if dim not in self.pieces:
            raise InputError(
                f"there is no contact in {dim} dimensions for elements of degree {self.degree}; "
                "take elements of degree 1",
                key,
            )
        return np.array(self.pieces[dim], dtype=np.int32)


def _with_rule(dx: ufl.Measure, rule: Rule) -> ufl.Measure:
    return dx(metadata=dict(rule)) if rule else dx


_VERTICES: Rule = {"quadrature_rule": "vertex", "quadrature_degree": 1}

#: Affine displacements.  The strain is constant in a cell, so that the locking law holds at one
#: point of the cell.  If the gap is affine, the contact condition at the nodes implies the
#: condition on the facets.
P1 = Element(
    degree=1,
    strain_degree=0,
    locking_rule={},
    contact_rule=_VERTICES,
    pieces={2: ((0, 1),), 3: ((0, 1, 2),)},
)

#: Quadratic displacements.  The strain is affine in a cell and its norm is convex: a constant limit
#: that holds at the corners of a cell holds in the cell.  The vertex rule is exact for affine
#: integrands only, and Z : eps(v) is quadratic: where a smooth solution locks, the order of
#: convergence in V is 1, as for P1, with a smaller error.  On edges the rule of Gauss and Lobatto
#: with three points, which is Simpson's, has the nodes as points and positive weights.  On
#: triangles no rule has both properties: the integrals of the basis functions of the corners are 0.
#: There is therefore no contact in three dimensions.
P2 = Element(
    degree=2,
    strain_degree=1,
    locking_rule=_VERTICES,
    contact_rule={"quadrature_rule": "GLL", "quadrature_degree": 3},
    pieces={2: ((0, 2), (2, 1))},
)

_GAUSS: Rule = {"quadrature_degree": 2}

#: P2 with limits at the points of Gauss's rule of degree 2, which is exact for Z : eps(v) with Z
#: affine in a cell.  The strain may exceed the limit between the points.  The elastic coefficients
#: count at the points alone: outside their convex hull an affine function through positive values
#: may be negative.
P2_GAUSS = replace(P2, locking_rule=_GAUSS, limit_at="gauss", elastic_rule=_GAUSS)

_ELEMENTS = {(1, "vertices"): P1, (1, "gauss"): P1, (2, "vertices"): P2, (2, "gauss"): P2_GAUSS}


def element_of(given: DiscretisationParameters) -> Element:
    """The element that a study file asks for."""
    return _ELEMENTS[given.degree, given.limit_at]
