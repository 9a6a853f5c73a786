"""Coulomb friction: the coefficient with its constants, as data of the friction bound.

The friction bound ``G = mu(s) |R sigma_nu|`` depends on the solution.  For a known bound the
functional of friction is convex, and the solvers rely on this.  ``s`` is ``|u_tau|`` in the static
problem, and the accumulated slip in a process.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError

Coefficient = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class FrictionLaw:
    """``mu(x, s) <= largest`` and ``|mu(x, s) - mu(x, t)| <= lipschitz |s - t|``, as (12) asks.

    ``coefficient`` maps points (k, d) and slips ``s = |u_tau|`` (k,) to ``mu`` (k,), or to one
    number.  ``largest`` is mu*, and ``lipschitz`` is L_mu, one over a length.  The certificate
    takes both constants as the law states them.  Where a constant is None, the certificate samples
    mu, which proves nothing.
    """

    coefficient: Coefficient
    largest: float | None = None
    lipschitz: float | None = None

    def __call__(self, points: FloatArray, slip: FloatArray) -> FloatArray:
        values = np.asarray(self.coefficient(points, slip), dtype=float)
        if values.shape not in ((), slip.shape):
            raise InputError(
                f"the coefficient of friction has values of the shape {values.shape} at "
                f"{len(slip)} points: it maps points (k, d) and slips (k,) to values (k,), as "
                "lambda x, s: 0.1 + 0.2*x[:, 0] does"
            )
        return np.broadcast_to(values, slip.shape)
