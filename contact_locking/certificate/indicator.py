"""An indicator of the discretisation error by recovery of the total stress and the strain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import fem, la

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.certificate.elliptic import NotApplicable
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.laws.elasticity import MANDEL_PAIRS, mandel_factor


@dataclass(frozen=True)
class ErrorIndicator:
    """``eta_K`` of each cell, ``sqrt(sum eta_K^2)``, and the same for the elastic stress."""

    field: fem.Function
    total: float
    elastic_field: fem.Function
    elastic: float


def error_indicator(state: SolvedState) -> ErrorIndicator:
    """``eta_K^2 = |int_K (s* - s) : (e* - e)|``, total stress ``s = A eps(u) + Z``, ``e = eps(u)``.

    s* and e* are continuous and piecewise linear: their values at a node are the means over the
    cells around the node, weighted by volume (Zienkiewicz and Zhu, doi:10.1002/nme.1620240206).
    The mean includes only cells of one named region, because stress and strain may jump between
    regions.

    ``total`` estimates ``int (s_exact - s) : (e_exact - e)`` and is not a bound.  Because the
    locking law is monotone, this integral is at least ``a(u_exact - u, u_exact - u)``, which
    ``elastic`` estimates.  The product with the strain is necessary: in a locked zone P1 elements
    reach the limit in about every second cell in 2D and in fewer cells in 3D, so that Z alternates
    between cells on every mesh, while the strain hardly does.  Raises NotApplicable for an element
    whose strain is not constant in a cell.  Collective.
    """
    if state.problem.element.degree != 1:
        raise NotApplicable("not applicable: for linear elements")
    points, m = state.points, len(MANDEL_PAIRS[state.dim])
    elastic, strain = _mandel(points.of(state.body.elastic_stress)), _mandel(points.strain)
    total = elastic + _mandel(points.locking_stress)
    values = np.column_stack([total, elastic, strain])
    defect = _recovered(state, values) - values[:, None, :]
    # The mass matrix of linear functions on a simplex: |K| (1 + delta_ij)/((d + 1)(d + 2)).
    mass = (1.0 + np.eye(state.dim + 1)) / ((state.dim + 1) * (state.dim + 2))

    def work(stress: FloatArray) -> FloatArray:
        product = np.einsum("kim,kjm,ij->k", stress, defect[:, :, 2 * m :], mass, optimize=True)
        return np.asarray(np.abs(product) * points.weights)

    square, elastic_square = work(defect[:, :, :m]), work(defect[:, :, m : 2 * m])
    return ErrorIndicator(
        _field(state, "error_indicator", square),
        float(np.sqrt(state.sum(square))),
        _field(state, "elastic_error_indicator", elastic_square),
        float(np.sqrt(state.sum(elastic_square))),
    )


def _field(state: SolvedState, name: str, square: FloatArray) -> fem.Function:
    """The roots of values (k,) of the owned cells as a function; collective."""
    space = state.problem.material.limit.function_space
    field = fem.Function(space, name=name)
    field.x.array[space.dofmap.list.reshape(-1)[: len(square)]] = np.sqrt(square)
    field.x.scatter_forward()
    return field


def _mandel(tensors: FloatArray) -> FloatArray:
    pairs = MANDEL_PAIRS[tensors.shape[1]]
    return np.stack([tensors[:, i, j] * mandel_factor(i, j) for i, j in pairs], axis=1)


def _recovered(state: SolvedState, values: FloatArray) -> FloatArray:
    """The nodal means (k, d + 1, m) of cell values (k, m) at the corners of each owned cell.

    Collective.
    """
    mesh, points, size = state.problem.domain.mesh, state.points, values.shape[1]
    space = state.problem.element.nodal_space(mesh, size + 1)
    corners = space.dofmap.list[: len(values)]
    result = np.empty((len(values), state.dim + 1, size))
    weighted = np.column_stack([values, np.ones(len(values))]) * points.weights[:, None]
    for inside in _regions(state, len(values)):
        sums = fem.Function(space)
        nodal = sums.x.array.reshape(-1, size + 1)
        np.add.at(nodal, corners[inside], weighted[inside][:, None, :])
        sums.x.scatter_reverse(la.InsertMode.add)
        sums.x.scatter_forward()
        around = nodal[corners[inside]]
        result[inside] = around[:, :, :size] / around[:, :, size:]
    return result


def _regions(state: SolvedState, count: int) -> list[BoolArray]:
    """Masks (k,) of the owned cells: one for each region of the material, one for all others."""
    rest = np.ones(count, dtype=bool)
    masks = []
    for name in sorted(state.problem.parameters.material.regions):
        mask = np.zeros(count, dtype=bool)
        found = state.problem.domain.cells(name)
        mask[found[found < count]] = True
        masks.append(mask)
        rest &= ~mask
    return [*masks, rest]
