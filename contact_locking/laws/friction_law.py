"""The coefficient of friction as a function of place and slip, with its constants."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from contact_locking.arrays import FloatArray

Coefficient = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class FrictionLaw:
    """``mu(x, s) <= largest`` and ``|mu(x, s) - mu(x, t)| <= lipschitz |s - t|``, as (12) asks.

    ``coefficient`` maps points (k, d) and slips ``s = |u_tau|`` (k,) to ``mu`` (k,).  ``largest``
    is mu*, and ``lipschitz`` is L_mu, one over a length.  The certificate takes both constants as
    the law states them.  Where a constant is None, the certificate samples mu, which proves
    nothing.
    """

    coefficient: Coefficient
    largest: float | None = None
    lipschitz: float | None = None

    def __call__(self, points: FloatArray, slip: FloatArray) -> FloatArray:
        return self.coefficient(points, slip)
