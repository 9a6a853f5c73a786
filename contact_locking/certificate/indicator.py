"""An indicator of the discretisation error by recovery of the total stress and the strain."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import basix
import numpy as np
from dolfinx import fem
from dolfinx import mesh as dmesh

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IndexArray, flattened
from contact_locking.certificate.elliptic import NotApplicable
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.fem import gauss_points
from contact_locking.laws.elasticity import mandel_values
from contact_locking.mesh.cell_kind import NAMED
from contact_locking.mesh.lagrange import lagrange, nodal_functions
from contact_locking.mesh.rank_sums import summed

# Where the points of a patch do not determine a quadratic polynomial, the quadratic terms vanish:
# their squares, with this factor, are added to the squares of the differences at the points.
_REGULARISATION = 1e-4


class PatchRecovery:
    """Continuous fields of degree 2 from fields in each cell, by patches of cells.

    1. For each node at a corner of cells, the patch is the set of cells around the node.
    2. A polynomial of degree 2 is fitted to the values of the fields at the points of Gauss's rule
       of degree 2 in the cells of the patch, by least squares.
    3. The value at a corner is the value of its polynomial.  The value in the middle of an edge, a
       face or a cell is the mean of the polynomials of the corners around.

    At the points of Gauss's rule strains of degree 2 are more accurate than elsewhere.

    The mesh has ``count`` owned cells (Zienkiewicz and Zhu, doi:10.1002/nme.1620330702).
    """

    def __init__(self, mesh: dmesh.Mesh, count: int) -> None:
        self._dim = mesh.topology.dim
        affine = fem.functionspace(mesh, ("P", 1)).dofmap
        self._corners: IndexArray = affine.list[:count]
        self._nodes_of = affine.index_map
        x = mesh.geometry.x[_compat.cell_nodes(mesh)[:count]][:, :, : self._dim]
        name, of_cell = mesh.topology.cell_name(), _compat.coordinate_map(mesh).degree
        shares = gauss_points.shares(name, of_cell=of_cell)
        self._points = np.einsum("qn,knd->kqd", shares, x)
        self._x = x[:, : NAMED[name].corners]
        # (n, c) the share of each corner in each node.
        self._shares = NAMED[name].basis(lagrange(name, 2).points)
        self._nodes = x if of_cell > 1 else np.einsum("nc,kcd->knd", self._shares, self._x)

    def nodal(self, values: FloatArray, inside: BoolArray) -> FloatArray:
        """The recovered values (k, nodes, m) at the nodes of the cells ``inside`` (count,).

        ``values`` (k, q, m) are those at the Gauss points of these cells.  Patches have cells
        inside alone.  Collective.
        """
        corners, size = self._corners[inside], self._sizes(inside)
        fits = self._fits(values, inside, size)
        result = np.zeros((len(values), len(self._shares), values.shape[2]))
        for corner in range(corners.shape[1]):
            shares = self._shares[:, corner]
            at = np.flatnonzero(shares > 0.0)
            origin, scale = self._x[inside, None, corner], size[corners[:, corner], None, None]
            monomials = _monomials((self._nodes[inside][:, at] - origin) / scale)
            found = np.einsum("knf,kfm->knm", monomials, fits[corners[:, corner]])
            result[:, at] += shares[at, None] * found
        return result

    def _sizes(self, inside: BoolArray) -> FloatArray:
        """(v,) the root mean square of the distances from each node to the points; collective."""
        apart = self._points[inside][:, :, None] - self._x[inside][:, None]
        squares = np.sum(apart**2, axis=(1, 3))
        sums = self._summed(
            np.stack([squares, np.full_like(squares, apart.shape[1])], axis=2), inside
        )
        return np.sqrt(sums[:, 0] / np.maximum(sums[:, 1], 1.0))

    def _fits(self, values: FloatArray, inside: BoolArray, size: FloatArray) -> FloatArray:
        """The coefficients (v, f, m) of the polynomials of the local nodes; collective."""
        corners, points = self._corners[inside], self._points[inside]
        terms = []
        for corner in range(corners.shape[1]):
            origin, scale = self._x[inside, None, corner], size[corners[:, corner], None, None]
            monomials = _monomials((points - origin) / scale)
            both = np.concatenate([monomials, values], axis=2)
            terms.append(np.einsum("kqf,kqg->kfg", monomials, both))
        shape = terms[0].shape[1:]
        flat = np.stack([flattened(term) for term in terms], axis=1)
        sums = self._summed(flat, inside).reshape(-1, *shape)
        number = shape[0]
        normal, right = sums[:, :, :number], sums[:, :, number:]
        weight = np.zeros(number)
        weight[1 + self._dim :] = _REGULARISATION
        normal = normal + normal[:, :1, :1] * np.diag(weight)
        found = np.zeros_like(right)
        there = normal[:, 0, 0] > 0.0
        found[there] = np.linalg.solve(normal[there], right[there])
        return found

    def _summed(self, values: FloatArray, inside: BoolArray) -> FloatArray:
        """(v, m) the sums over the cells around each local node of values (k, c, m)."""
        return summed(self._nodes_of, self._corners[inside], values)


def _monomials(y: FloatArray) -> FloatArray:
    """1, the components, and their products: (k, n, f) for y (k, n, d)."""
    pairs = itertools.combinations_with_replacement(range(y.shape[2]), 2)
    squares = [y[:, :, i] * y[:, :, j] for i, j in pairs]
    return np.stack([np.ones(y.shape[:2]), *np.moveaxis(y, 2, 0), *squares], axis=2)


@dataclass(frozen=True)
class ErrorIndicator:
    """``eta_K`` of each cell, ``sqrt(sum eta_K^2)``, and the same for the elastic stress."""

    field: fem.Function
    total: float
    elastic_field: fem.Function
    elastic: float


def error_indicator(state: SolvedState) -> ErrorIndicator:
    """``eta_K^2 = |int_K (s* - s) : (e* - e)|``, total stress ``s = A eps(u) + Z``, ``e = eps(u)``.

    For degree 1, s* and e* are continuous and of degree 1: their values at a node are the means
    over the cells around the node, weighted by volume (Zienkiewicz and Zhu,
    doi:10.1002/nme.1620240206).  For degree 2 they are continuous and of degree 2
    (`PatchRecovery`), and s and e have the values at the points of the strains and the degree of
    the strains, as in simplices and parallelepipeds.  The cells around a node are those of one
    named region, because stress and strain may jump between regions.

    ``total`` estimates ``int (s_exact - s) : (e_exact - e)``, which is at least what ``elastic``
    estimates, ``a(u_exact - u, u_exact - u)``; neither is a bound (docs/certificate.md).  Raises
    NotApplicable for an element whose strain is not determined by the values at its points.
    Collective.
    """
    points, element = state.points, state.problem.element
    pairs = element.kinematics.mandel_pairs(state.dim)
    m = len(pairs)
    elastic = mandel_values(points.of(state.body.elastic_stress), pairs)
    total, strain = (
        elastic + mandel_values(points.locking_stress, pairs),
        mandel_values(points.strain, pairs),
    )
    values = np.concatenate([total, elastic, strain], axis=1)
    weights = points.by_cell(points.weights)
    if element.degree == 1:
        means = np.einsum("kq,kqm->km", weights, values.reshape(*weights.shape, 3 * m))
        means /= weights.sum(axis=1, keepdims=True)
        corners = lagrange(state.problem.domain.kind.name, 1).points
        defect = _recovered(state, means) - _at(state, values, corners)
    elif element.strain_degree > 0:
        defect = _defect_of_quadratic(state, values)
    else:
        raise NotApplicable("not applicable: the points of the element do not determine the strain")
    cell_volumes = weights.sum(axis=1)
    mass = _mass(state.problem.domain.kind.name, element.degree)

    def work(stress: FloatArray) -> FloatArray:
        product = np.einsum("kim,kim->k", stress, mass @ defect[:, :, 2 * m :])
        return np.asarray(np.abs(product) * cell_volumes)

    square, elastic_square = work(defect[:, :, :m]), work(defect[:, :, m : 2 * m])
    return ErrorIndicator(
        cell_field(state, "error_indicator", square),
        float(np.sqrt(state.sum(square))),
        cell_field(state, "elastic_error_indicator", elastic_square),
        float(np.sqrt(state.sum(elastic_square))),
    )


def cell_field(state: SolvedState, name: str, square: FloatArray) -> fem.Function:
    """The roots of values (k,) of the owned cells as a function; collective."""
    mesh = state.problem.domain.mesh
    space = state.system.kept("cells", lambda: fem.functionspace(mesh, ("DG", 0)))
    field = fem.Function(space, name=name)
    field.x.array[space.dofmap.list.reshape(-1)[: len(square)]] = np.sqrt(square)
    field.x.scatter_forward()
    return field


def _defect_of_quadratic(state: SolvedState, values: FloatArray) -> FloatArray:
    """The recovered minus the given fields (k, nodes, m) at the nodes of degree 2 in each cell.

    ``values`` are those at the points of the strains.  Collective.
    """
    name = state.problem.domain.kind.name
    at_points = _at(state, values, gauss_points.points(name, 1))
    given = _at(state, values, lagrange(name, 2).points)
    recovery = PatchRecovery(state.problem.domain.mesh, len(given))
    defect = np.empty_like(given)
    for inside in _regions(state, len(given)):
        defect[inside] = recovery.nodal(at_points[inside], inside) - given[inside]
    return defect


def _at(state: SolvedState, values: FloatArray, places: FloatArray) -> FloatArray:
    """The values (k, n, m) at n places of each cell of those at the points of the strains."""
    element, name = state.problem.element, state.problem.domain.kind.name
    degree = element.strain_degree
    if degree == 0:
        return values[:, None]
    own = gauss_points.points(name, degree)
    if element.limit_at == "vertices":
        own = lagrange(name, degree).points
    inverse = np.linalg.inv(nodal_functions(name, degree, own))
    table = nodal_functions(name, degree, places) @ inverse
    return np.einsum("nq,kqm->knm", table, values.reshape(-1, len(own), values.shape[1]))


def _mass(name: str, degree: int) -> FloatArray:
    """The mass matrix of the nodal basis of a degree on a cell of a kind, of volume 1."""
    points, weights = basix.make_quadrature(basix.CellType[name], 2 * degree)
    basis = nodal_functions(name, degree, points)
    return np.asarray(basis.T @ (weights[:, None] * basis) / weights.sum())


def _recovered(state: SolvedState, values: FloatArray) -> FloatArray:
    """The nodal means (k, c, m) of cell values (k, m) at the c corners of each owned cell.

    Collective.
    """
    dofmap = state.problem.u.function_space.dofmap
    volumes = state.points.by_cell(state.points.weights).sum(axis=1)
    corners, size = dofmap.list[: len(values)], values.shape[1]
    result = np.empty((*corners.shape, size))
    weighted = np.column_stack([values, np.ones(len(values))]) * volumes[:, None]
    for inside in _regions(state, len(values)):
        at = corners[inside]
        nodal = summed(dofmap.index_map, at, np.repeat(weighted[inside, None], at.shape[1], axis=1))
        # Nodes without a cell inside have no mean, and no cell inside has such a node.
        means = nodal[:, :size] / np.where(nodal[:, size:] > 0.0, nodal[:, size:], 1.0)
        result[inside] = means[at]
    return result


def _regions(state: SolvedState, count: int) -> list[BoolArray]:
    """Masks (k,) of the owned cells: one for each region of the material, one for all others."""
    rest = np.ones(count, dtype=bool)
    masks = []
    for found in state.problem.regions:
        mask = np.zeros(count, dtype=bool)
        mask[found[found < count]] = True
        masks.append(mask)
        rest &= ~mask
    return [*masks, rest]
