"""Elements: the spaces of the discretisation, and the points, with weights, at which the laws hold.

All that depends on the element is in this module, so that a new element is a new object of
:class:`Element`.  The points in the cells are corners, midpoints, or those of Gauss's rule of
degree 2; those on Gamma_C belong to the element's :class:`Trace`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING, Any

import basix
import basix.ufl
import dolfinx
import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx import mesh as dmesh
from ufl.core.expr import Expr

from contact_locking import _compat
from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.fem.compiled import Kept
from contact_locking.laws.body import REVOLUTION, STRAIGHT, Kinematics
from contact_locking.mesh.data import NAMED, lagrange, nodal_functions
from contact_locking.mesh.domain import Domain

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


@cache
def gauss_shares(cell: str) -> FloatArray:
    """The values (q, c) of the functions of a cell's corners, with a row for each point."""
    return nodal_functions(cell, 1, gauss_points(cell))


def gauss_points(cell: str) -> FloatArray:
    """The points (q, d) of Gauss's rule of degree 2 in the reference cell, in the order of corners.

    A cell has as many points as corners: the functions are affine in a simplex, and of degree 1 in
    each coordinate of a quadrilateral or a hexahedron.
    """
    places, _ = basix.make_quadrature(basix.CellType[cell], 2)
    apart = np.linalg.norm(lagrange(cell, 1).points[:, None] - places, axis=2)
    return np.asarray(places[np.argmin(apart, axis=1)])


@cache
def gauss_element(cell: str, shape: tuple[int, ...] = ()) -> Any:
    """The element of discontinuous functions whose dofs are the values at the points of the rule.

    ``shape`` is the shape of the values, () for scalars.
    """
    kind, dim, places = basix.CellType[cell], NAMED[cell].dim, gauss_points(cell)
    number = len(places)
    # basix takes points and dual functionals for the entities of each of the dimensions 0 to 3.
    below = basix.topology(kind)[:dim]
    above: list[list[Any]] = [[]] * (3 - dim)
    no_points = [[np.zeros((0, dim))] * len(entities) for entities in below]
    no_functionals = [[np.zeros((0, 1, 0, 1))] * len(entities) for entities in below]
    scalars = basix.ufl.custom_element(
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
    return basix.ufl.blocked_element(scalars, shape=shape) if shape else scalars


#: A quadrature rule as the metadata of a measure; the empty rule is exact for polynomials.
Rule = Mapping[str, Any]

# The shares of the values at the ends and in the middle of an edge in the control value of its
# middle, and those of the control values in the value there.
_CONTROL, _NODAL = np.array([-0.5, -0.5, 2.0]), np.array([0.25, 0.25, 0.5])


@dataclass(frozen=True)
class Trace:
    """The points of a facet, which are its nodes, with positive weights, and the values there.

    ``rules`` maps the dimension d to a quadrature rule on the facets whose points are the nodes of
    the displacement.  ``pieces`` maps d to the pieces of a facet, each with d nodes of the facet;
    the nodes of a facet are numbered from 0, with the corners first.  The element has no contact in
    a dimension without entries.

    ``controls`` are the dimensions d in which the laws of contact and friction limit the control
    values of a trace, which are for quadratic displacements; elsewhere they limit the values at the
    nodes.  Control values are the value at a corner, and ``2 u_m - (u_1 + u_2)/2`` at the midpoint
    m of the edge between the corners 1 and 2: the coefficients of the trace in Bernstein's basis
    (docs/problem.md).
    """

    rules: Mapping[int, Rule]
    pieces: Mapping[int, tuple[tuple[int, ...], ...]]
    controls: tuple[int, ...] = ()

    def check(self, dim: int, degree: int, key: str) -> None:
        """Raise InputError with the key if there is no contact in ``dim`` dimensions."""
        if dim not in self.rules:
            raise InputError(
                f"there is no contact in {dim} dimensions for these elements of degree {degree}; "
                "use elements of degree 1",
                key,
            )


def facet_places(domain: Domain, facets: IndexArray, cells: IndexArray) -> IndexArray:
    """(m,) which facet of its cell each of m local facets is."""
    topology, dim = domain.mesh.topology, domain.dim
    topology.create_connectivity(dim, dim - 1)
    all_facets = topology.connectivity(dim, dim - 1).array
    facets_of = all_facets.reshape(-1, len(domain.kind.facets))
    return np.argmax(facets_of[cells] == facets[:, None], axis=1).astype(np.int32)


def facet_nodes(
    domain: Domain, space: fem.FunctionSpace, facets: IndexArray, cells: IndexArray
) -> IndexArray:
    """The local nodes (m, n) of facets (m,) with their cells (m,), the corners first."""
    place, layout = facet_places(domain, facets, cells), space.dofmap.dof_layout
    numbers = range(len(domain.kind.facets))
    closure = np.array([layout.entity_closure_dofs(domain.dim - 1, i) for i in numbers])
    return np.asarray(space.dofmap.list[cells[:, None], closure[place]])


class ControlValues:
    """The linear map from nodal values on Gamma_C to the values that the laws limit.

    ``scalars`` is the space of scalar fields of the displacement's degree, and ``blocks`` (n,) are
    the n local nodes of ``scalars`` as blocks of the displacements in ``vectors``.  ``nodes`` (k,)
    are the owned nodes of ``scalars`` on Gamma_C.
    """

    def __init__(
        self,
        trace: Trace,
        scalars: fem.FunctionSpace,
        vectors: fem.FunctionSpace,
        nodes: IndexArray,
        blocks: IndexArray,
    ) -> None:
        self._nodes, self.blocks, self._vectors = nodes, blocks, vectors
        #: Whether the limited values are the nodal values.
        self.are_nodal = vectors.mesh.topology.dim not in trace.controls
        no_edges = np.empty((0, 3), dtype=np.int32)
        self._edges = no_edges if self.are_nodal else _edges(scalars, nodes)

    @property
    def rows(self) -> csr_matrix:
        """The map (k, N) from all N blocks of displacements, by their global numbers."""
        from scipy.sparse import csr_matrix

        index_map, local = self._vectors.dofmap.index_map, self.of_blocks
        columns = index_map.local_to_global(local.indices.astype(np.int32))
        shape = (local.shape[0], index_map.size_global)
        return csr_matrix((local.data, columns, local.indptr), shape=shape)

    @property
    def of_blocks(self) -> csr_matrix:
        """The map (k, n) from the values of a displacement at its local blocks."""
        return self._map(self._nodes, self.blocks, _CONTROL)

    def of_scalars(self, function: fem.Function) -> FloatArray:
        """The limited values (k,) of a function of the scalar space."""
        rows = self._map(self._nodes, np.arange(len(self.blocks)), _CONTROL)
        return np.asarray(rows @ function.x.array)

    def forces(self, at_nodes: FloatArray) -> FloatArray:
        """The forces (k, d) on limited values for forces (k, d) on nodal values; collective."""
        if self.are_nodal:
            return at_nodes
        vector = fem.Function(self._vectors).x
        vector.array[:] = (self.inverse(self._nodes, self.blocks).T @ at_nodes).reshape(-1)
        vector.scatter_reverse(la.InsertMode.add)
        return np.asarray(vector.array.reshape(-1, at_nodes.shape[1])[self.blocks[self._nodes]])

    def edges(self, function: fem.Function) -> IndexArray:
        """(m, 3) the ends and the middle of each edge whose middle has a control value.

        They are nodes or blocks of the function.
        """
        return self._edges if function.ufl_shape == () else self.blocks[self._edges]

    def inverse(self, nodes: IndexArray, numbers: IndexArray) -> csr_matrix:
        """The map from limited to nodal values (k, m), for numbers (n,) < m of the local nodes."""
        return self._map(nodes, numbers, _NODAL)

    def _map(self, nodes: IndexArray, numbers: IndexArray, shares: FloatArray) -> csr_matrix:
        """1 at corners, and at each middle the ``shares`` of the nodes of its edge."""
        # `check` does without SciPy, whose import takes a tenth of its time.
        from scipy.sparse import csr_matrix

        row = np.full(len(self.blocks), -1)
        row[nodes] = np.arange(len(nodes))
        middles = self._edges[:, 2]
        corners = np.setdiff1d(nodes, middles)
        rows = np.concatenate([row[corners], np.repeat(row[middles], 3)])
        columns = np.concatenate([corners, self._edges.reshape(-1)])
        values = np.concatenate([np.ones(len(corners)), np.tile(shares, len(middles))])
        shape = (len(nodes), int(numbers.max(initial=-1)) + 1)
        return csr_matrix((values, (rows, numbers[columns])), shape=shape)


def make_nodal(function: fem.Function, places: Sequence[ControlValues]) -> None:
    """Replace limited values, given as values at the nodes, by nodal values; collective.

    This changes the owned nodes of the ``places``, which may overlap.
    """
    values = function.x.array.reshape(-1, *function.ufl_shape)
    limited = values.copy()
    for place in places:
        edges = place.edges(function)
        values[edges[:, 2]] = np.tensordot(_NODAL, limited[edges], axes=(0, 1))
    function.x.scatter_forward()


def _edges(scalars: fem.FunctionSpace, nodes: IndexArray) -> IndexArray:
    """(m, 3) the nodes of the edges whose middles are among ``nodes``: the ends, the middle."""
    element = lagrange(scalars.mesh.topology.cell_name(), 2)
    # The numbers of nodes ascend from the corners to the middle.
    local = np.array([sorted(closure) for closure in element.entity_closure_dofs[1]])
    edges = scalars.dofmap.list[:, local].reshape(-1, 3)
    edges = edges[np.isin(edges[:, 2], nodes)]
    return np.asarray(edges[np.unique(edges[:, 2], return_index=True)[1]])


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
    for elastic coefficients that are affine in a cell.  ``trace`` has the points on Gamma_C where
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
            return fem.functionspace(mesh, gauss_element(mesh.topology.cell_name(), shape))
        return fem.functionspace(mesh, ("DG", self.strain_degree, shape))

    def shared_strain_space(
        self, kept: Kept, mesh: dolfinx.mesh.Mesh, shape: tuple[int, ...] = ()
    ) -> fem.FunctionSpace:
        """The :meth:`strain_space`, made once for each ``kept``; collective.

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
            shares = gauss_shares(mesh.topology.cell_name())
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
    trace=Trace(rules={2: _VERTICES, 3: _VERTICES}, pieces={2: ((0, 1),), 3: ((0, 1, 2),)}),
)


def _nodes_alike(*points: tuple[float, ...], measure: float) -> Rule:
    """The rule with equal weights at the nodes of the reference facet of this measure."""
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
        pieces={2: ((0, 2), (2, 1)), 3: ((0, 5, 4), (1, 3, 5), (2, 4, 3), (3, 4, 5))},
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
