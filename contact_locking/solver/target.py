"""What a strategy is asked for."""

from __future__ import annotations

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
