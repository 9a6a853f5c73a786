"""Elements: the spaces of the discretisation, and the points, with weights, at which the laws hold.

All that depends on the element is here, so that another element is another :class:`Element`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from ufl.core.expr import Expr

from contact_locking import _compat
from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError
from contact_locking.fem import gauss_points
from contact_locking.fem.compiled import Kept
from contact_locking.fem.trace import Rule, Trace
from contact_locking.laws.kinematics import REVOLUTION, STRAIGHT, Kinematics


@dataclass(frozen=True)
class Element:
    """Displacements, strains, and the points of the laws, on simplices or ``boxes``.

    Boxes are quadrilaterals and hexahedra; there a degree is that in each coordinate of the
    reference cell.  Displacements are continuous and of degree ``degree`` in each cell, 1 on boxes.
    Strains, stresses and limits are discontinuous and of degree ``strain_degree``, 0 or 1.
    Their degrees of freedom are the values at the midpoint of each cell for degree 0.  For degree 1
    they are the values at as many points as a cell has corners, one beside each corner in the order
    of the corners: the corners themselves, or ``at_gauss_points`` those of Gauss's rule of degree
    2.

    The points of ``locking_rule``, the rule for integrals of the locking law over the cells, must
    be the points of the strains: the limit then holds at these points, with the weights of the
    rule.  ``elastic_rule`` is the rule for integrals of the elastic stress; the empty rule is exact
    for elastic coefficients that are affine in a cell.  ``trace`` tells at which points of Gamma_C
    contact and friction act.  ``kinematics`` are those of the body.
    """

    degree: int
    strain_degree: int
    locking_rule: Rule
    trace: Trace
    at_gauss_points: bool = False
    elastic_rule: Rule = field(default_factory=dict)
    kinematics: Kinematics = STRAIGHT
    boxes: bool = False

    def __str__(self) -> str:
        """The element in words."""
        where = "the Gauss points" if self.at_gauss_points else "the vertices"
        body = ", axisymmetric" if self.kinematics.axisymmetric else ""
        if self.boxes:
            body += " on quadrilaterals or hexahedra"
        if self.strain_degree == 0:
            return f"degree {self.degree}{body}"
        return f"degree {self.degree}{body}, the locking limit at {where} of each cell"

    def facts(self) -> dict[str, Any]:
        """The keys of the study file that choose the element."""
        body: dict[str, Any] = {"axisymmetric": True} if self.kinematics.axisymmetric else {}
        body |= {"cells": "box"} if self.boxes else {}
        return {"degree": self.degree, **body}

    def strain(self, u: Expr) -> Expr:
        """``eps(u)``, a symmetric (m, m) tensor: m is d, and 3 for a body of revolution."""
        return self.kinematics.strain(u)

    def strain_shape(self, mesh: dolfinx.mesh.Mesh) -> tuple[int, int]:
        """The shape (m, m) of strains and stresses."""
        size = self.kinematics.tensor_size(mesh.topology.dim)
        return size, size

    def displacement_space(self, mesh: dolfinx.mesh.Mesh) -> fem.FunctionSpace:
        """The space of displacements; collective."""
        return fem.functionspace(mesh, ("P", self.degree, (mesh.topology.dim,)))

    def strain_space(
        self, mesh: dolfinx.mesh.Mesh, shape: tuple[int, ...] = ()
    ) -> fem.FunctionSpace:
        """The space of strains, stresses and limits; collective.

        ``shape`` is the shape of the values, () for scalars.
        """
        if self.at_gauss_points:
            return fem.functionspace(mesh, gauss_points.element(mesh.topology.cell_name(), shape))
        return fem.functionspace(mesh, ("DG", self.strain_degree, shape))

    def shared_strain_space(
        self, kept: Kept, mesh: dolfinx.mesh.Mesh, shape: tuple[int, ...] = ()
    ) -> fem.FunctionSpace:
        """The :meth:`strain_space` that all have who share ``kept``; collective.

        DOLFINx takes some milliseconds to make one, as long as a tangent of a small problem.
        """
        name = "strain space", self.strain_degree, self.at_gauss_points, shape
        return kept(name, lambda: self.strain_space(mesh, shape))

    def strain_places(self, mesh: dolfinx.mesh.Mesh) -> FloatArray:
        """The coordinates (d, k) of the points of the strains, local cell by local cell.

        Ghost cells are included.
        """
        dim = mesh.topology.dim
        index_map = mesh.topology.index_map(dim)
        cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        if self.strain_degree == 0:
            return np.asarray(dmesh.compute_midpoints(mesh, dim, cells)[:, :dim].T)
        places = mesh.geometry.x[_compat.cell_corners(mesh)[cells], :dim]
        if self.at_gauss_points:
            shares = gauss_points.shares(mesh.topology.cell_name())
            places = np.einsum("pc,kcd->kpd", shares, places)
        return np.asarray(places.reshape(-1, dim).T)

    def height(self, mesh: ufl.Mesh, dim: int) -> Expr:
        """A length of the order of the height of each cell, in a measure of degree 1."""
        if self.boxes:
            return abs(ufl.JacobianDeterminant(mesh)) / ufl.CellDiameter(mesh) ** (dim - 1)
        return ufl.CellVolume(mesh) / ufl.Circumradius(mesh) ** (dim - 1)

    @property
    def at_peaks(self) -> Element:
        """The element with strains at points where |eps(u)| is largest in each cell.

        A convex function of an affine strain is largest at a corner, and so is that of a bilinear
        or trilinear strain in a parallelogram or a parallelepiped; other boxes are near these.
        This is the element itself if its strain is constant in a cell or has its points at the
        corners, and for bodies of revolution, where the hoop strain is not affine and not a number
        at a corner on the axis.
        """
        if self.kinematics.axisymmetric or not self.at_gauss_points:
            return self
        return replace(self, at_gauss_points=False)

    def locking_dx(self, dx: ufl.Measure) -> ufl.Measure:
        """The measure ``dx`` with the locking rule."""
        return _with_rule(dx, self.locking_rule)

    def elastic_dx(self, dx: ufl.Measure) -> ufl.Measure:
        """The measure ``dx`` with the elastic rule."""
        return _with_rule(dx, self.elastic_rule)


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
    trace=Trace(
        rules={2: _VERTICES, 3: _VERTICES},
        pieces={2: ((0, 1),), 3: ((0, 1, 2),)},
    ),
)


def _nodes_alike(*points: tuple[float, ...], measure: float) -> Rule:
    """The rule with equal weights at the nodes of the reference facet, which has a measure."""
    return {
        "quadrature_rule": "custom",
        "quadrature_points": points,
        "quadrature_weights": (measure / len(points),) * len(points),
        "quadrature_degree": 1,
    }


#: Quadratic displacements.  The strain is affine in a cell and its norm is convex: a constant limit
#: that holds at the corners of a cell holds in the cell.  Contact and friction limit the control
#: values of the trace, whose weights are equal.  (At the nodes themselves the weights of a triangle
#: are 0 at the corners.)
P2 = Element(
    degree=2,
    strain_degree=1,
    locking_rule=_VERTICES,
    trace=Trace(
        rules={
            2: _nodes_alike((0.0,), (1.0,), (0.5,), measure=1.0),
            3: _nodes_alike(
                (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 0.5), (0.0, 0.5), (0.5, 0.0), measure=0.5
            ),
        },
        pieces={
            2: ((0, 2), (2, 1)),
            3: ((0, 5, 4), (1, 3, 5), (2, 4, 3), (3, 4, 5)),
        },
        controls=(2, 3),
    ),
)

_MIDPOINT: Rule = {"quadrature_degree": 1}

#: P1 for bodies of revolution: all laws hold at the midpoints of the cells, where the hoop strain
#: is the quotient of the means of u_r and r.  The rule is exact for ``2 pi r Z : eps(v)`` with Z
#: constant in a cell.
P1_REVOLUTION = replace(P1, locking_rule=_MIDPOINT, elastic_rule=_MIDPOINT, kinematics=REVOLUTION)

_GAUSS: Rule = {"quadrature_degree": 2}

#: P2 for bodies of revolution.  Corners can lie on the axis, the points of Gauss's rule of degree 2
#: cannot.  The elastic coefficients count at these points alone: outside their convex hull an
#: affine function through positive values may be negative.
P2_REVOLUTION = replace(
    P2, locking_rule=_GAUSS, at_gauss_points=True, elastic_rule=_GAUSS, kinematics=REVOLUTION
)

_FACE = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0))

#: Bilinear or trilinear displacements on quadrilaterals and hexahedra.  The limit holds at the
#: Gauss points, 2 in each direction.  Their rule is exact for Z : eps(v) with constant Z in every
#: cell with straight edges, so that a body with constant stress is in equilibrium to rounding; a
#: rule with the corners as its points is not.
Q1 = Element(
    degree=1,
    strain_degree=1,
    locking_rule=_GAUSS,
    trace=Trace(
        rules={2: _VERTICES, 3: _nodes_alike(*_FACE, measure=1.0)},
        pieces={2: ((0, 1),), 3: ((0, 1, 2), (3, 2, 1))},
    ),
    at_gauss_points=True,
    elastic_rule=_GAUSS,
    boxes=True,
)

#: Q1 for bodies of revolution: no Gauss point lies on the axis.
Q1_REVOLUTION = replace(Q1, kinematics=REVOLUTION)

_ELEMENTS = {1: P1, 2: P2}
_OF_REVOLUTION = {1: P1_REVOLUTION, 2: P2_REVOLUTION}


def element_of(degree: int, axisymmetric: bool = False, boxes: bool = False) -> Element:
    """The element of a degree, 1 or 2.

    The strain keeps the limit at the vertices of each cell, hence everywhere, and at the Gauss
    points for an axisymmetric body and in ``boxes``.  Raises InputError where there is no such
    element.
    """
    if boxes and degree > 1:
        raise InputError(
            "must be 1 on quadrilaterals and hexahedra; elements of degree 2 are for triangles and "
            "tetrahedra (mesh.cells: simplex)",
            "discretisation.degree",
        )
    if boxes:
        return Q1_REVOLUTION if axisymmetric else Q1
    return (_OF_REVOLUTION if axisymmetric else _ELEMENTS)[degree]
