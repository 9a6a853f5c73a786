"""The numbers that a fit searches, and the residuals at them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray

# The change of the numbers that is 1 to the search, and so the longest first step.
_UNIT = 0.3
# Singular values below this share of the largest are rounding, and the end of a central path.
ROUNDING = 1e-7


@dataclass(frozen=True)
class Variable:
    """A number that is searched, with its start and its bounds."""

    key: str
    start: float
    least: float
    largest: float
    is_log: bool

    @property
    def _unit(self) -> float:
        return _UNIT * (abs(self.start) or 1.0)

    def number(self, x: float) -> float:
        """p(x)."""
        if self.is_log:
            return float(self.start * np.exp(_UNIT * x))
        return float(self.start + self._unit * x)

    def searched(self, number: float) -> float:
        """x(p)."""
        if self.is_log:
            with np.errstate(divide="ignore"):
                return float(np.log(number / self.start)) / _UNIT
        return (number - self.start) / self._unit

    def rate(self, number: float) -> float:
        """dp/dx."""
        return _UNIT * number if self.is_log else self._unit


@dataclass(frozen=True)
class Residuals:
    """Residuals (m,) over their standard errors, and their derivatives (m, n) by the numbers."""

    values: FloatArray
    derivatives: FloatArray | None


#: The residuals at the numbers (n,); None where there is no solution.
Misfit = Callable[[FloatArray], Residuals | None]


def rates(variables: Sequence[Variable], numbers: FloatArray) -> FloatArray:
    """dp/dx (n,)."""
    return np.array([v.rate(value) for v, value in zip(variables, numbers, strict=True)])
