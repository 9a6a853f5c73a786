"""An indicator of the discretisation error, by recovered stresses and strains."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import basix
import numpy as np
from dolfinx import common, fem

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IndexArray, flattened
from contact_locking.certificate.penalty_error import NotApplicable
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.fem.spaces import gauss_points, gauss_shares
from contact_locking.laws.body import mandel_values
from contact_locking.mesh.data import lagrange, nodal_functions
from contact_locking.mesh.distribution import summed

# The factor of the squares of quadratic terms that are added to the least squares of a patch, so
# that they vanish where its points do not determine a quadratic polynomial.
_REGULARISATION = 1e-4


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
    (`_patch_recovery`), and s and e are affine in each cell.  The cells around a node are those of
    one named region, because stress and strain may jump between regions.

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
    """The recovered minus the computed fields (k, nodes, m) at the nodes of degree 2 in each cell.

    ``values`` are at the points of the strains.  Collective.
    """
    mesh, kind = state.problem.domain.mesh, state.problem.domain.kind
    at_points = _at(state, values, gauss_points(kind.name))
    computed = _at(state, values, lagrange(kind.name, 2).points)
    affine, count = fem.functionspace(mesh, ("P", 1)).dofmap, len(computed)
    x = mesh.geometry.x[_compat.cell_corners(mesh)[:count]][:, :, : state.dim]
    points = np.einsum("qc,kcd->kqd", gauss_shares(kind.name), x)
    # (n, c) the share of each corner in each node.
    shares = kind.basis(lagrange(kind.name, 2).points)
    nodes = np.einsum("nc,kcd->knd", shares, x)
    defect = np.empty_like(computed)
    for inside in _regions(state, count):
        corners = affine.list[:count][inside]
        parts = [array[inside] for array in (x, points, nodes, at_points)]
        recovered = _patch_recovery(affine.index_map, shares, corners, *parts)
        defect[inside] = recovered - computed[inside]
    return defect


def _patch_recovery(
    nodes_of: common.IndexMap,
    shares: FloatArray,
    corners: IndexArray,
    x: FloatArray,
    points: FloatArray,
    nodes: FloatArray,
    values: FloatArray,
) -> FloatArray:
    """The continuous fields (k, n, m) of degree 2 at the nodes (k, n, d) of k cells; collective.

    1. For each node at a corner (k, c) of cells, the patch is the set of cells around the node.
    2. A polynomial of degree 2 is fitted to the values (k, q, m) of the fields at the points (k, q,
       d) of Gauss's rule of degree 2 in the cells of the patch, by least squares.
    3. The value at a corner is the value of its polynomial.  The value in the middle of an edge is
       the mean of the polynomials of its ends.

    At the points of Gauss's rule strains of degree 2 are more accurate than elsewhere (Zienkiewicz
    and Zhu, doi:10.1002/nme.1620330702).
    """
    squares = np.sum((points[:, :, None] - x[:, None]) ** 2, axis=(1, 3))
    counted = np.stack([squares, np.full_like(squares, points.shape[1])], axis=2)
    sums = summed(nodes_of, corners, counted)
    size = np.sqrt(sums[:, 0] / np.maximum(sums[:, 1], 1.0))

    def monomials(places: FloatArray, corner: int) -> FloatArray:
        return _monomials((places - x[:, None, corner]) / size[corners[:, corner], None, None])

    terms, every = [], range(corners.shape[1])
    for corner in every:
        shapes = monomials(points, corner)
        both = np.concatenate([shapes, values], axis=2)
        terms.append(np.einsum("kqf,kqg->kfg", shapes, both))
    number = shapes.shape[2]
    flat = np.stack([flattened(term) for term in terms], axis=1)
    sums = summed(nodes_of, corners, flat).reshape(-1, number, both.shape[2])
    normal, right = sums[:, :, :number], sums[:, :, number:]
    weight = np.where(np.arange(number) > x.shape[2], _REGULARISATION, 0.0)
    normal = normal + normal[:, :1, :1] * np.diag(weight)
    fits, has_patch = np.zeros_like(right), normal[:, 0, 0] > 0.0
    fits[has_patch] = np.linalg.solve(normal[has_patch], right[has_patch])
    recovered = np.zeros((*nodes.shape[:2], values.shape[2]))
    for corner in every:
        at = np.flatnonzero(shares[:, corner] > 0.0)
        of_corner = monomials(nodes[:, at], corner) @ fits[corners[:, corner]]
        recovered[:, at] += shares[at, corner, None] * of_corner
    return recovered


def _at(state: SolvedState, values: FloatArray, places: FloatArray) -> FloatArray:
    """Values at the points of the strains, interpolated to n places of each cell: (k, n, m)."""
    element, name = state.problem.element, state.problem.domain.kind.name
    if element.strain_degree == 0:
        return values[:, None]
    points = gauss_points(name) if element.at_gauss_points else lagrange(name, 1).points
    inverse = np.linalg.inv(nodal_functions(name, 1, points))
    table = nodal_functions(name, 1, places) @ inverse
    return np.einsum("nq,kqm->knm", table, values.reshape(-1, len(points), values.shape[1]))


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
    corners = dofmap.list[: len(values)]
    volumes = state.points.by_cell(state.points.weights).sum(axis=1)
    result = np.empty((len(values), corners.shape[1], values.shape[1]))
    for inside in _regions(state, len(values)):
        at = corners[inside]
        result[inside] = nodal_means(dofmap.index_map, at, values[inside], volumes[inside])
    return result


def nodal_means(
    nodes_of: common.IndexMap, corners: IndexArray, values: FloatArray, weights: FloatArray
) -> FloatArray:
    """The weighted means of values (k, m) over the cells around each corner: (k, c, m); collective.

    ``corners`` (k, c) are the local numbers of the corners of k cells.
    """
    weighted = np.column_stack([values, np.ones(len(values))]) * weights[:, None]
    sums = summed(nodes_of, corners, np.repeat(weighted[:, None], corners.shape[1], axis=1))
    # The means of nodes without a cell are not used.
    means = sums[:, :-1] / np.where(sums[:, -1:] > 0.0, sums[:, -1:], 1.0)
    return np.asarray(means[corners])


def _regions(state: SolvedState, count: int) -> list[BoolArray]:
    """Masks (k,) of the owned cells: for each region of the material, and for all other cells."""
    others = np.ones(count, dtype=bool)
    masks = []
    for region in state.problem.regions:
        mask = np.zeros(count, dtype=bool)
        mask[region[region < count]] = True
        masks.append(mask)
        others &= ~mask
    return [*masks, others]
