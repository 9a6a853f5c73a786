"""The choice of the cells to refine."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.mesh.file.data import MeshData
from contact_locking.results.solution import Solution

# Contributions that differ by this share count as equal: where a problem is symmetric, its mesh
# stays symmetric, and rounding, which depends on the number of ranks, does not decide.
_TIE = 1e-6
# A point of a cell has barycentric coordinates above this.
_INSIDE = -1e-6


def marked_cells(squares: FloatArray, share: float) -> BoolArray:
    """The fewest cells K with ``sum eta_K^2 >= share * sum of all eta_K^2``, as a mask (k,).

    ``squares`` (k,) are the contributions ``eta_K^2 >= 0``, and ``share`` is in (0, 1].  Cells
    whose contributions equal the smallest that is taken are taken as well.  Without an error no
    cell is marked (Doerfler, doi:10.1137/0733054).
    """
    order = np.argsort(-squares, kind="stable")
    sums = np.cumsum(squares[order])
    if not len(sums) or sums[-1] <= 0.0:
        return np.zeros(len(squares), dtype=bool)
    # The last of the sums may be less than the share of itself by rounding.
    last = min(int(np.searchsorted(sums, share * sums[-1])), len(sums) - 1)
    return np.asarray((squares >= (1.0 - _TIE) * squares[order[last]]) & (squares > 0.0))


def entered_places(solution: Solution) -> list[tuple[float, ...]]:
    """Where foundations enter between the nodes of Gamma_C by a notable depth; collective.

    They are the same on all ranks.
    """
    return [place for fields in solution.contacts for place in fields.entry.places]


def squared_contributions(solution: Solution) -> FloatArray:
    """The squared contributions (k,) of the owned cells to the error; only their ratios count.

    With the locking stress, which alternates between cells on every mesh, they would lead to locked
    zones: they are those of the elastic stress.  They are zero where there is no estimate, as on a
    mesh that misses a foundation.
    """
    mesh, field = solution.domain.mesh, solution.elastic_error_indicator
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    if field is None:
        return np.zeros(owned)
    return np.asarray(field.x.array[field.function_space.dofmap.list[:owned, 0]] ** 2)


def cells_at(places: list[tuple[float, ...]], data: MeshData) -> BoolArray:
    """The cells (k,) that have one of some places."""
    corners = data.points[data.cells.nodes]
    found = np.zeros(len(corners), dtype=bool)
    inverse = np.linalg.inv((corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1))
    for place in places:
        rest = np.einsum("kij,kj->ki", inverse, np.array(place) - corners[:, 0])
        shares = np.column_stack([1.0 - rest.sum(axis=1), rest])
        found |= shares.min(axis=1) > _INSIDE
    return found
