"""What is prescribed to stresses in balance: displacements, gaps, loads and tractions.

A traction ``-p nu + q`` on Gamma_C, from the forces of a solution, is admissible if ``p >= 0`` and
``|q| <= G``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_arguments, extract_type
from ufl.differentiation import Derivative

from contact_locking.arrays import BoolArray, FloatArray, IndexArray, IntArray
from contact_locking.certificate.penalty_error import NotApplicable
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.fem import compiled
from contact_locking.parallel import maximum, on_any_rank
from contact_locking.problem.forms import ProblemData
from contact_locking.results.derived import ContactFields
from contact_locking.theory.constants import require_held
from contact_locking.theory.equilibrated_stress import Forces
from contact_locking.theory.triangles import (
    FACET_ENDS,
    MacroElement,
    Triangles,
    absolute_integral,
    bernstein,
    between,
    control_values,
    in_parts,
    lagrange,
    legendre,
    legendre_moments,
    product_integral,
)

# Rounding in normals, and relative to the largest displacement.
_ROUNDING = 1e-10


@dataclass(frozen=True)
class ContactTractions:
    """The traction of one contact on the m facets of this rank, by control values.

    ``cells`` (m,) and ``sides`` (m,) say which side of which triangle each facet is.  ``normal``
    (m, 2) is the contact normal, ``gap``, ``pressure`` and ``bound`` are (m, r + 1), and ``along``
    (m, r + 1) is the friction traction along the tangent ``(-nu_2, nu_1)``.  ``fixed`` (m, r + 1)
    marks the held nodes.
    """

    fields: ContactFields
    cells: IntArray
    sides: IntArray
    nodes: IndexArray
    lengths: FloatArray
    normal: FloatArray
    gap: FloatArray
    pressure: FloatArray
    along: FloatArray
    bound: FloatArray
    fixed: BoolArray

    @property
    def tangent(self) -> FloatArray:
        return _tangent(self.normal)

    def split(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """``u_nu`` and ``u_tau`` as control values (m, r + 1), from values at all nodes (k, 2)."""
        values = u[self.nodes]
        along = (np.einsum("mri,mi->mr", values, unit) for unit in (self.normal, self.tangent))
        normal, tangent = map(control_values, along)
        return normal, tangent

    def moments(self, degree: int) -> FloatArray:
        """The moments (m, k + 1, 2) of the traction along the facets of the cells."""
        rubbing = self.along[:, :, None] * self.tangent[:, None]
        vectors = rubbing - self.pressure[:, :, None] * self.normal[:, None]
        return self.lengths[:, None, None] * legendre_moments(vectors, degree)

    def work(self, normal: FloatArray, tangent: FloatArray, gap: FloatArray) -> FloatArray:
        """``int p (g - w_nu) + G |w_tau| + q . w_tau`` over each facet (m,) of this rank.

        All arguments are control values.  Every term is non-negative for an admissible w.
        """
        opening = product_integral(self.pressure, gap - normal)
        friction = absolute_integral(self.bound, tangent) + product_integral(self.along, tangent)
        return np.asarray(self.lengths * (opening + friction))


def _tangent(normal: FloatArray) -> FloatArray:
    return np.column_stack([-normal[:, 1], normal[:, 0]])


def contact_tractions(fields: ContactFields, triangles: Triangles) -> ContactTractions:
    """The traction of a solution, made admissible at the control points; collective.

    Raises NotApplicable where the contact normal changes along a facet: then no polynomial traction
    without friction is normal to the foundation everywhere.
    """
    surface, contact = fields.surface, fields.contact
    cells, sides = triangles.sides_on(surface.facets)
    dofmap = surface.scalar_space.dofmap
    layout = dofmap.dof_layout
    closures = np.array([layout.entity_closure_dofs(1, side) for side in range(3)])
    # The closure lists both ends before the inner nodes.
    order = [0, *range(2, closures.shape[1]), 1]
    nodes = dofmap.list[cells[:, None], closures[sides][:, order]]
    normals = surface.vector_function(contact.normals).x.array.reshape(-1, 2)[nodes]
    turning = np.abs(normals - normals[:, :1]) > _ROUNDING
    if on_any_rank(surface.domain.comm, turning):
        raise NotApplicable("the contact normal changes along a facet")

    # Values that the laws limit are control values, unless the element limits nodal values.
    controls = control_values if surface.controls.are_nodal else np.asarray

    def of(values: FloatArray) -> FloatArray:
        return controls(surface.scalar_function(values).x.array[nodes])

    fixed = surface.scalar_function((~contact.free).astype(float)).x.array[nodes] > 0.5
    normal = normals[:, 0]
    tangent = _tangent(normal)
    friction = surface.vector_function(fields.traction).x.array.reshape(-1, 2)
    along = controls(np.einsum("mri,mi->mr", friction[nodes], tangent))
    bound = np.maximum(of(fields.bound), 0.0)
    return ContactTractions(
        fields,
        cells,
        sides,
        nodes,
        triangles.lengths[cells, sides],
        normal,
        of(contact.gaps),
        np.maximum(_continued(of(fields.pressure), fixed), 0.0),
        np.clip(_continued(along, fixed), -bound, bound),
        bound,
        fixed,
    )


def _continued(values: FloatArray, fixed: BoolArray) -> FloatArray:
    """Give the fixed control points (m, r + 1) at one end of a facet the value of the other end.

    At held nodes the solution has no contact forces, whatever the forces beside them.
    """
    values = values.copy()
    for first, last in ((0, -1), (-1, 0)):
        alone = fixed[:, first] & ~fixed[:, last]
        values[alone, first] = values[alone, last]
    return values


# Values are compared at so many points of each facet, both ends included.
_SAMPLES = 8
# Rounding in distances, relative to the body.
_ROUNDING_OF_DISTANCES = 1e-12


def require_straight_triangles(state: SolvedState) -> None:
    """Raise NotApplicable for a mesh on which there are no stresses in balance here."""
    domain, element = state.problem.domain, state.problem.element
    if state.dim != 2:
        raise NotApplicable(
            "not in three dimensions, where the system for the stress has about 20 unknowns a cell"
        )
    if domain.axisymmetric:
        raise NotApplicable("not for axisymmetric bodies, whose equilibrium has other terms")
    if element.boxes:
        raise NotApplicable("the stresses in equilibrium are for triangles, not quadrilaterals")
    require_held(state)


def held_components(state: SolvedState, triangles: Triangles) -> BoolArray:
    """(n, 3, 2) which components are prescribed on each facet; collective.

    Raises NotApplicable for supports along other directions than the axes, and if the displacement
    of the solution differs from the prescribed values at one of 8 points of a facet: the solution
    then does not have these values between the nodes.
    """
    held = np.zeros((*triangles.facets.shape, 2), dtype=bool)
    problem, worst, s = state.problem, 0.0, np.arange(_SAMPLES) / (_SAMPLES - 1.0)
    if problem.constraints.oblique:
        raise NotApplicable("a support holds a direction that is no axis")
    if problem.constraints.bcs:
        raise NotApplicable("conditions of DOLFINx prescribe values at nodes")
    samples, nodal = between(FACET_ENDS, s), triangles.at_nodes(problem.u)
    shapes = np.stack([lagrange(problem.element.degree, points) for points in samples])
    for condition in problem.constraints.components:
        cells, sides = triangles.sides_on(problem.domain.facets(condition.on, condition.key))
        held[cells, sides, condition.component] = True
        places = between(triangles.ends[cells, sides], s)
        prescribed = condition.value(places.reshape(-1, 2).T).reshape(len(cells), _SAMPLES)
        values = np.einsum("msi,mi->ms", shapes[sides], nodal[cells, :, condition.component])
        worst = max(worst, float(np.abs(prescribed - values).max(initial=0.0)))
    if maximum(state.comm, worst) > _ROUNDING * state.largest_displacement:
        raise NotApplicable("prescribed displacements are not met between the nodes")
    return held


def require_exact_gaps(
    state: SolvedState, triangles: Triangles, contacts: list[ContactTractions]
) -> None:
    """Raise NotApplicable if a gap differs from the polynomial through its nodes; collective.

    The values are compared at 8 points of each facet.
    """
    s, worst = np.arange(_SAMPLES) / (_SAMPLES - 1.0), 0.0
    for contact in contacts:
        places = between(triangles.ends[contact.cells, contact.sides], s)
        at_places = contact.fields.contact.foundation.gap(places.reshape(-1, 2).T)
        exact = at_places.reshape(len(places), _SAMPLES)
        interpolated = np.einsum("mr,sr->ms", contact.gap, bernstein(contact.gap.shape[1] - 1, s))
        worst = max(worst, float(np.abs(exact - interpolated).max(initial=0.0)))
    if maximum(state.comm, worst) > _ROUNDING_OF_DISTANCES * state.target.length:
        raise NotApplicable("the gap is not met between the nodes of the mesh")


# A part of a load that is below this share of it is rounding.
_NO_LOAD = 1e-12
# The quadrature degree of loads.
_DEGREE = 8


@dataclass
class BalancedLoads:
    """Loads that stresses of degree k balance: polynomials of degree k - 1 inside, and k on sides.

    ``body`` (n, 3, l, 2) are values of the body force at the load points of the macro-element,
    ``moments`` (n, 3, k + 1, 2) the moments of the tractions along the facets of the cells.
    """

    body: FloatArray
    moments: FloatArray

    @classmethod
    def none(cls, triangles: Triangles, element: MacroElement) -> BalancedLoads:
        """No loads."""
        n, k = len(triangles.areas), element.degree
        body = np.zeros((n, 3, element.load_points.shape[1], 2))
        return cls(body, np.zeros((n, 3, k + 1, 2)))


def balanced_loads(data: ProblemData, triangles: Triangles, element: MacroElement) -> BalancedLoads:
    """The body force, tractions and pressures; collective.

    Raises NotApplicable for a load that cannot be evaluated at points, or is no such polynomial.
    """
    loads = BalancedLoads.none(triangles, element)
    for integral in () if data.loads is None else data.loads.integrals():
        kind, load = integral.integral_type(), _density(integral.integrand())
        if integral.metadata().get("quadrature_rule") == "custom":
            raise NotApplicable("a load changes too sharply inside of a cell or facet")
        if kind == "cell":
            if integral.subdomain_id() != "everywhere":
                raise NotApplicable("a body force acts on a part of the body only")
            _add_body_force(loads, load, triangles, element)
        elif kind == "exterior_facet":
            tags, marks = integral.subdomain_data(), integral.subdomain_id()
            if tags is None or marks == "everywhere":
                raise NotApplicable("a traction acts on a part of the boundary without a name")
            numbers = marks if isinstance(marks, tuple) else (marks,)
            facets = np.unique(np.concatenate([tags.find(number) for number in numbers]))
            _add_traction(loads, load, triangles, facets, element.degree)
        else:
            raise NotApplicable(f"a load acts on the measure {kind!r}")
    return loads


def _density(integrand: Any) -> Any:
    """The load f (2,) in ``f . v``; raises NotApplicable for other linear forms of v."""
    (test,) = extract_arguments(integrand)
    for derivative in extract_type(integrand, Derivative):
        if extract_arguments(derivative):
            raise NotApplicable("a load does work along strains")
    units = [ufl.as_vector([float(i == j) for j in range(2)]) for i in range(2)]
    return ufl.as_vector([ufl.replace(integrand, {test: unit}) for unit in units])


def _add_body_force(
    loads: BalancedLoads, load: Any, triangles: Triangles, element: MacroElement
) -> None:
    points, _ = basix.make_quadrature(basix.CellType.triangle, _DEGREE)
    cells, shapes = np.arange(len(triangles.areas)), lagrange(element.degree - 1, points)
    body = _values(load, triangles, element.load_points, cells)
    values = _values(load, triangles, in_parts(points), cells)
    rest = values - np.einsum("qi,ntid->ntqd", shapes, body)
    why = f"a body force is not of degree {element.degree - 1}"
    _require_rounding(triangles, rest, values, why)
    loads.body += body


def _add_traction(
    loads: BalancedLoads, load: Any, triangles: Triangles, facets: IndexArray, degree: int
) -> None:
    points, weights = basix.make_quadrature(basix.CellType.interval, _DEGREE + degree)
    s = points[:, 0]
    cells, sides = triangles.sides_on(facets)
    places, values = between(FACET_ENDS, s), np.empty((len(cells), len(s), 2))
    # Only integrals over facets know the outward normal.  Here it is a field for each side.
    space = fem.functionspace(triangles.domain.mesh, ("DG", 0, (2,)))
    normal, dofs = fem.Function(space), space.dofmap.list[: len(triangles.areas), 0]
    in_cells = ufl.replace(load, dict.fromkeys(extract_type(load, ufl.FacetNormal), normal))
    for side in range(3):
        normal.x.array.reshape(-1, 2)[dofs] = triangles.normals[:, side]
        on_side = sides == side
        values[on_side] = _values(in_cells, triangles, places, cells[on_side])[:, side]
    table = legendre(degree, s)
    moments = np.einsum("q,qj,mqd->mjd", weights, table, values)
    rest = values - np.einsum("qj,mjd->mqd", table, moments)
    _require_rounding(triangles, rest, values, f"a traction is not of degree {degree}")
    # A side of a cell occurs once in a measure.
    loads.moments[cells, sides] += triangles.lengths[cells, sides][:, None, None] * moments


def _require_rounding(triangles: Triangles, rest: FloatArray, whole: FloatArray, why: str) -> None:
    """Raise NotApplicable where a rest is more than rounding of the whole; collective."""
    comm = triangles.domain.comm
    if maximum(comm, np.abs(rest)) > _NO_LOAD * maximum(comm, np.abs(whole)):
        raise NotApplicable(f"{why} in a cell")


def _values(load: Any, triangles: Triangles, points: FloatArray, cells: IntArray) -> FloatArray:
    """The load (m, 3, q, 2) in m cells at points (3, q, 2) of the reference; collective."""
    try:
        expression = compiled.expression(load, points.reshape(-1, 2))
    except (ValueError, RuntimeError, TypeError) as error:
        raise NotApplicable("a load cannot be evaluated at points") from error
    if not len(cells):
        return np.empty((0, *points.shape))
    values = expression.eval(triangles.domain.mesh, cells.astype(np.int32))
    return np.asarray(values).reshape(len(cells), *points.shape)


def balanced_forces(
    triangles: Triangles, held: BoolArray, loads: BalancedLoads, contacts: list[ContactTractions]
) -> Forces:
    """The tractions of loads and contacts; ``held`` (n, 3, 2) marks the prescribed components."""
    moments, degree = loads.moments.copy(), loads.moments.shape[2] - 1
    for contact in contacts:
        np.add.at(moments, (contact.cells, contact.sides), contact.moments(degree))
    turned = triangles.signs[:, :, None, None] ** np.arange(degree + 1)[:, None]
    return Forces(held, loads.body, moments * turned)
