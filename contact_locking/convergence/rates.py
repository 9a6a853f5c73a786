"""Rates of convergence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def fitted_rate(sizes: Sequence[float], errors: Sequence[float]) -> float:
    """The exponent r of ``error = C size^r``: the least-squares slope of the logarithms.

    Raises ValueError for fewer than two sizes, and for errors or sizes that are not positive.
    """
    x, y = np.asarray(sizes, dtype=float), np.asarray(errors, dtype=float)
    if len(np.unique(x)) < 2 or x.shape != y.shape:
        raise ValueError("a rate takes two or more sizes and an error for each")
    if not (np.all(x > 0.0) and np.all(y > 0.0)):
        raise ValueError("a rate takes sizes and errors above zero")
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])
