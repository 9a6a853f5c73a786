"""Central differences of solves, to compare derivatives with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from contact_locking.arrays import FloatArray

# The widths of two central differences, relative to the value of the parameter.
WIDTHS = (1e-4, 3e-5)
# Two differences that disagree by more than this, relative, tell nothing: a point changes its state
# between the solves.
AGREE = 1e-3
# A derivative by ``ln p`` below this share of the quantity is judged by that share: a difference of
# two solves has no more digits.
LEAST = 1e-2


def difference(values: Callable[[float], FloatArray], at: float, width: float) -> FloatArray:
    """``d values/d ln p`` by a central difference of this width."""
    return np.asarray((values(at * (1.0 + width)) - values(at * (1.0 - width))) / (2.0 * width))


def errors(
    derivatives: FloatArray, values: Callable[[float], FloatArray], at: float
) -> tuple[FloatArray, FloatArray]:
    """Errors of derivatives (m,) by p at the value ``at``, and whether differences tell them.

    The errors are relative to the derivative by ``ln p``, or to a share of the quantity.
    """
    wide, narrow = (difference(values, at, width) for width in WIDTHS)
    size = np.maximum(np.abs(narrow), LEAST * np.abs(values(at)))
    with np.errstate(all="ignore"):
        told = np.abs(wide - narrow) <= AGREE * size
        return np.abs(derivatives * at - narrow) / size, told
