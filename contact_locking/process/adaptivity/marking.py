"""The choice of the cells to refine."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray

# Contributions that differ by this share count as equal: where a problem is symmetric, its mesh
# stays symmetric, and rounding, which depends on the number of ranks, does not decide.
_TIE = 1e-6


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
