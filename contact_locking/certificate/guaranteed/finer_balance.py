"""Loads that stresses of degree k do not balance: most of them by stresses of degree k + 1.

The rest of the loads does no work along rigid motions of a triangle.  A stress on this triangle
alone, with no traction on the inner facets, can therefore balance the rest.
"""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, flattened
from contact_locking.certificate.guaranteed.data_oscillation import BalancedLoads
from contact_locking.certificate.guaranteed.macro_element import (
    MacroElement,
    lagrange,
    macro_element,
)
from contact_locking.certificate.guaranteed.triangles import Triangles

# Singular values of the reference element below this share are zero.
_RANK = 1e-10


def finer_stress(
    stress: FloatArray,
    coarse: BalancedLoads,
    fine: BalancedLoads,
    held: BoolArray,
    cells: Triangles,
) -> tuple[FloatArray, MacroElement]:
    """A stress that balances the loads ``fine`` of degree k + 1, and its element.

    ``stress`` (n, 3, m, 3) balances the loads ``coarse`` of degree k, and ``held`` (n, 3, 2) marks
    the components that are prescribed on a facet.  Of all stresses in a triangle that balance the
    difference, the result has the least coefficients in the reference triangle.
    """
    low = macro_element(coarse.moments.shape[2] - 1)
    high = macro_element(low.degree + 1)
    points = macro_element(1).points
    same = lagrange(low.degree, _corner_coordinates(high.points[0], points[0]))
    raised = np.einsum("pq,ntqa->ntpa", same, stress)
    at = lagrange(low.degree - 1, _corner_coordinates(high.load_points[0], points[0]))
    body = fine.body - np.einsum("lk,ntkd->ntld", at, coarse.body)
    moments = np.where(held[:, :, None], 0.0, fine.moments)
    moments[:, :, : low.degree + 1] = 0.0
    back = np.linalg.inv(cells.maps)
    wanted = flattened(-flattened(body, kept=1) @ np.swapaxes(back, 1, 2))
    tractions = flattened(moments, kept=1) @ np.swapaxes(back, 1, 2)
    tractions /= cells.determinants[:, None, None]
    rest = flattened(tractions) - wanted @ high.lift_moments.reshape(len(high.lifts), -1)
    table = high.moments.reshape(len(high.basis), -1)
    chosen = rest @ np.linalg.pinv(table, rcond=_RANK)
    own = wanted @ high.lifts.reshape(len(high.lifts), -1)
    own += chosen @ high.basis.reshape(len(high.basis), -1)
    return raised + cells.moved(own.reshape(raised.shape)), high


def _corner_coordinates(points: FloatArray, corners: FloatArray) -> FloatArray:
    """The coordinates (q, 2), in the reference triangle, of points in a part with these corners."""
    edges = (corners[1:] - corners[0]).T
    return np.asarray(np.linalg.solve(edges, (points - corners[0]).T).T)
