"""What a strategy is asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """The penalty parameters, and the scales of the problem that starting values are made from.

    ``n`` may be infinite and ``epsilon`` zero: the variational inequality itself.  ``stiffness``
    is the largest eigenvalue of A, ``length`` the extent of the body.
    """

    n: float
    epsilon: float
    stiffness: float
    length: float

    def least_bound(self, energy: float, dim: int) -> float:
        """The L2 norm on Gamma_C below which changes of the friction bound are judged absolutely.

        It is a thousandth of the mean elastic stress over a face of the body: where contact only
        grazes, relative changes of next to nothing say nothing.
        """
        stress = math.sqrt(2.0 * max(energy, 0.0) * self.stiffness / self.length**dim)
        return 1e-3 * stress * self.length ** (0.5 * (dim - 1))
