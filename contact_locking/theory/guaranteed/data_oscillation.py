"""Loads that the stresses balance exactly, and a proved bound of the work of the rest.

The rest of a load does no work along rigid motions of a triangle; the inequalities of Poincare and
Korn and a trace inequality bound its work.  The proof is in docs/certificate.md.
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

from contact_locking.arrays import FloatArray, IndexArray, IntArray
from contact_locking.certificate.elliptic import NotApplicable
from contact_locking.fem import compiled
from contact_locking.problem.forms import ProblemData
from contact_locking.theory.guaranteed.triangles import (
    FACET_ENDS,
    MacroElement,
    Triangles,
    between,
    in_parts,
    lagrange,
    legendre,
)

# A part of a load that is below this share of it is rounding.
_ROUNDING = 1e-13
# The quadrature degree of loads that are no constants.
_DEGREE = 8


@dataclass
class BalancedLoads:
    """The part of the loads that the stresses of degree k balance.

    ``body`` (n, 3, l, 2) are values of the body force at the load points of the macro-element,
    ``moments`` (n, 3, k + 1, 2) the moments of the tractions along the facets of the cells.
    ``body_rest`` (n,) and ``rest`` (n, 3) are the norms of the parts left out, in L2.
    """

    body: FloatArray
    moments: FloatArray
    body_rest: FloatArray
    rest: FloatArray

    @classmethod
    def none(cls, triangles: Triangles, element: MacroElement) -> BalancedLoads:
        """No loads."""
        n, k = len(triangles.areas), element.degree
        body = np.zeros((n, 3, element.load_points.shape[1], 2))
        return cls(body, np.zeros((n, 3, k + 1, 2)), np.zeros(n), np.zeros((n, 3)))

    def oscillation(self, triangles: Triangles) -> FloatArray:
        """(n,) o_K with ``|(f, v) - (balanced part, v)| <= sum_K o_K |eps(v)|_K``.

        With Korn's constant C, ``|grad(v - r)| <= C |eps(v)|`` on each triangle for a rotation r,
        the factors are ``C h/pi`` inside, and ``C h sqrt(|F|/|K| (1/pi^2 + 1/pi))`` on a facet F.
        """
        a, b, c = np.sort(triangles.lengths, axis=1).T
        # The smallest angle is opposite to the shortest edge.
        cosine = (b**2 + c**2 - a**2) / (2.0 * b * c)
        half_sine = np.sqrt(np.maximum(0.5 * (1.0 - cosine), 0.0))
        sizes = c * np.sqrt(1.0 + 8.0 / half_sine**2)
        share = triangles.lengths / triangles.areas[:, None] * (1.0 / np.pi**2 + 1.0 / np.pi)
        on_facets = sizes[:, None] * np.sqrt(share) * self.rest
        return np.asarray(sizes / np.pi * self.body_rest + np.sum(on_facets, axis=1))


def balanced_loads(data: ProblemData, triangles: Triangles, element: MacroElement) -> BalancedLoads:
    """The projections of body force, tractions and pressures; collective.

    Raises NotApplicable for a load that cannot be evaluated at points.
    """
    found = BalancedLoads.none(triangles, element)
    for integral in () if data.loads is None else data.loads.integrals():
        kind, load = integral.integral_type(), _density(integral.integrand())
        if integral.metadata().get("quadrature_rule") == "custom":
            raise NotApplicable("a load changes too sharply inside of a cell or facet")
        if kind == "cell":
            if integral.subdomain_id() != "everywhere":
                raise NotApplicable("a body force acts on a part of the body only")
            _add_body_force(found, load, triangles, element)
        elif kind == "exterior_facet":
            tags, wanted = integral.subdomain_data(), integral.subdomain_id()
            if tags is None or wanted == "everywhere":
                raise NotApplicable("a traction acts on a part of the boundary without a name")
            numbers = wanted if isinstance(wanted, tuple) else (wanted,)
            facets = np.unique(np.concatenate([tags.find(number) for number in numbers]))
            _add_traction(found, load, triangles, facets, element.degree)
        else:
            raise NotApplicable(f"a load acts on the measure {kind!r}")
    return found


def _density(integrand: Any) -> Any:
    """The load f (2,) in ``f . v``; raises NotApplicable for other linear forms of v."""
    (test,) = extract_arguments(integrand)
    for derivative in extract_type(integrand, Derivative):
        if extract_arguments(derivative):
            raise NotApplicable("a load does work along strains")
    units = [ufl.as_vector([float(i == j) for j in range(2)]) for i in range(2)]
    return ufl.as_vector([ufl.replace(integrand, {test: unit}) for unit in units])


def _add_body_force(
    found: BalancedLoads, load: Any, triangles: Triangles, element: MacroElement
) -> None:
    points, weights = basix.make_quadrature(basix.CellType.triangle, _DEGREE)
    # The weights of the reference triangle add up to 1/2.
    weights, places = 2.0 * weights, in_parts(points)
    cells = np.arange(len(triangles.areas))
    values = _values(load, triangles, places, cells)
    shapes = lagrange(element.degree - 1, points)
    inverse = np.linalg.inv(element.load_mass)
    body = np.einsum("ij,qj,q,ntqd->ntid", inverse, shapes, weights, values)
    if element.degree == 1:
        body += _turning(values - body, weights, triangles, places)
    rest = values - np.einsum("qi,ntid->ntqd", shapes, body)
    squares = [np.einsum("q,ntqd->n", weights, part**2) for part in (rest, values)]
    # Several body forces add up; so do the norms of the parts left out.
    found.body += body
    found.body_rest += np.sqrt(triangles.areas / 3.0 * _beyond_rounding(*squares))


def _turning(
    rest: FloatArray, weights: FloatArray, triangles: Triangles, places: FloatArray
) -> FloatArray:
    """Constants (n, 3, 1, 2) without a resultant that have the moment of the rest (n, 3, q, 2)."""
    arms = triangles.at(places) - triangles.corners.mean(axis=1)[:, None, None]
    turned = np.stack([-arms[..., 1], arms[..., 0]], axis=-1)
    moment = np.einsum("q,ntqd,ntqd->n", weights, turned, rest)
    middle = np.einsum("q,ntqd->ntd", weights, turned)
    factor = moment / np.einsum("ntd,ntd->n", middle, middle)
    return np.asarray((factor[:, None, None] * middle)[:, :, None])


def _add_traction(
    found: BalancedLoads, load: Any, triangles: Triangles, facets: IndexArray, degree: int
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
        here = sides == side
        values[here] = _values(in_cells, triangles, places, cells[here])[:, side]
    table = legendre(degree, s)
    moments = np.einsum("q,qj,mqd->mjd", weights, table, values)
    rest = values - np.einsum("qj,mjd->mqd", table, moments)
    lengths = triangles.lengths[cells, sides]
    # A side of a cell occurs once in a measure.
    found.moments[cells, sides] += lengths[:, None, None] * moments
    squares = [np.einsum("q,mqd->m", weights, part**2) for part in (rest, values)]
    found.rest[cells, sides] += np.sqrt(lengths * _beyond_rounding(*squares))


def _beyond_rounding(rest: FloatArray, whole: FloatArray) -> FloatArray:
    """The squares (m,) of the parts left out, or 0 where they are rounding of the whole."""
    return np.where(rest > _ROUNDING**2 * whole, rest, 0.0)


def _values(load: Any, triangles: Triangles, points: FloatArray, cells: IntArray) -> FloatArray:
    """The load (m, 3, q, 2) in m cells at points (3, q, 2) of the reference; collective."""
    try:
        expression = compiled.expression(load, points.reshape(-1, 2))
    except (ValueError, RuntimeError, TypeError) as error:
        raise NotApplicable("a load cannot be evaluated at points") from error
    if not len(cells):
        return np.empty((0, *points.shape))
    found = expression.eval(triangles.domain.mesh, cells.astype(np.int32))
    return np.asarray(found).reshape(len(cells), *points.shape)
