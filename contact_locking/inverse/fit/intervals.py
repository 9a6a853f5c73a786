"""95 % intervals, judged by the misfit at their ends.

In the linear model the least squares over all other numbers rise by ``q^2 s^2`` between their
minimum and the end ``q e`` of an interval, with Student's quantile q, the scatter s^2 and the
standard error e.  A friction coefficient above which everything sticks, or a limit above all
strains, is beyond a kink of the misfit: there the misfit hardly rises, and the interval reaches to
where it does, or is open.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray

from .variables import ROUNDING, Misfit, Variable, rates

# An end whose misfit rises by less than this share of what the linear model says is too near.
_TOO_FLAT = 0.7
# Gauss-Newton steps of the other numbers, and halvings of the logarithm of a distance.
_CORRECTIONS, _HALVINGS = 2, 6
# Ends are located to this factor, from this share of the way to the farthest number.
_FACTOR, _NEAREST = 1.3, 1e-3
# A number without a bound is followed to so many times its size.
_FARTHEST = 10.0
# Errors below this, in units of the search, are those of its end and not of the data.
_LEAST_ERROR = 1e-5


@dataclass(frozen=True)
class _Place:
    """Searched numbers (n,) with their residuals (m,) and slopes (m, n) by them."""

    x: FloatArray
    residuals: FloatArray
    slopes: FloatArray

    @property
    def misfit(self) -> float:
        return float(self.residuals @ self.residuals)

    def predicted(self, number: int, value: float, bounds: FloatArray) -> tuple[FloatArray, float]:
        """Where the linear model has the least squares with a number of this value, and these."""
        others = np.arange(len(self.x)) != number
        change = value - self.x[number]
        right = self.residuals + self.slopes[:, number] * change
        steps = np.linalg.lstsq(self.slopes[:, others], -right, rcond=ROUNDING)[0]
        x, left = self.x.copy(), right + self.slopes[:, others] @ steps
        x[number] = value
        x[others] += steps
        return np.clip(x, *bounds), float(left @ left)


class Intervals:
    """The intervals at the least squares (n,), by the residuals and slopes there.

    ``quantile`` is q, and ``scale`` is s.
    """

    def __init__(
        self,
        variables: Sequence[Variable],
        misfit: Misfit,
        numbers: FloatArray,
        residuals: FloatArray,
        slopes: FloatArray,
        quantile: float,
        scale: float,
    ) -> None:
        self._variables, self._misfit = variables, misfit
        x = [v.searched(number) for v, number in zip(variables, numbers, strict=True)]
        self._best = _Place(np.array(x), residuals, slopes)
        ends = [[v.searched(v.least), v.searched(v.largest)] for v in variables]
        self._bounds = np.array(ends).T
        self._quantile, self._rise = quantile, (quantile * scale) ** 2
        self._most = self._best.misfit + self._rise

    def of(self, number: int, error: float) -> tuple[float, float]:
        """The ends for a searched number with its standard error; infinite where it is open."""
        reach = self._quantile * error
        if not math.isfinite(self._rise) or reach <= _LEAST_ERROR:
            return self._numbers(number, -reach, reach)
        low, high = (self._end(number, side, reach, False) for side in (-1.0, 1.0))
        # Where the linear model fails on one side, its end on the other side may be far too wide.
        if low > reach == high:
            high = self._end(number, 1.0, reach, True)
        elif high > reach == low:
            low = self._end(number, -1.0, reach, True)
        return self._numbers(number, -low, high)

    def _numbers(self, number: int, low: float, high: float) -> tuple[float, float]:
        variable, x = self._variables[number], float(self._best.x[number])
        ends = [variable.number(x + step) if math.isfinite(step) else step for step in (low, high)]
        return ends[0], ends[1]

    def _end(self, number: int, side: float, reach: float, is_sharp: bool) -> float:
        """The distance of the end on one side: the reach, or more where the misfit is flat.

        A sharp end is searched within the reach, too, and so is one that a bound excludes.
        """
        far = self._far(number)
        bound = float(self._bounds[int(side > 0.0), number])
        farthest = min(side * (bound - float(self._best.x[number])), far)
        if farthest <= _LEAST_ERROR:
            return reach
        first, start = min(reach, farthest), self._best.misfit
        flat = start + _TOO_FLAT * self._rise * (first / reach) ** 2
        goal = self._most if first < reach else flat
        place = self._at(number, side * first, self._best, goal)
        misfit = math.inf if place is None else place.misfit
        is_beyond = misfit > self._most
        if misfit >= flat and not (is_beyond and (is_sharp or first < reach)):
            return reach if reach <= far else math.inf
        if is_beyond or place is None:
            place, low, high = self._best, _NEAREST * first, first
        else:
            low, high = first, farthest
            last = self._at(number, side * farthest, place, self._most)
            if first == farthest or (last is not None and last.misfit <= self._most):
                return math.inf
        for _ in range(_HALVINGS):
            if high <= _FACTOR * low:
                break
            middle = math.sqrt(low * high)
            found = self._at(number, side * middle, place, self._most)
            if found is not None and found.misfit <= self._most:
                low, place = middle, found
            else:
                high = middle
        # Only the bound itself is excluded, or the farthest number.
        return math.inf if high == farthest else high

    def _far(self, number: int) -> float:
        """The distance of a number that is many times as large or as small."""
        variable = self._variables[number]
        if variable.is_log:
            return abs(variable.searched(variable.start * _FARTHEST))
        size = abs(variable.number(float(self._best.x[number]))) or abs(variable.start) or 1.0
        return (_FARTHEST - 1.0) * size / variable.rate(size)

    def _at(self, number: int, distance: float, known: _Place, goal: float) -> _Place | None:
        """The least squares at a distance, as near as it takes to tell whether they reach a goal.

        ``known`` is a place near.  None where there is no solution.
        """
        value, place = float(self._best.x[number]) + distance, None
        for _ in range(1 + _CORRECTIONS):
            x, expected = known.predicted(number, value, self._bounds)
            if place is None and known is not self._best:
                # Beyond a kink the slopes before it lead the other numbers astray.
                x = known.x.copy()
                x[number] = value
            if place is not None and (place.misfit <= goal or expected > goal):
                break
            numbers = [v.number(float(at)) for v, at in zip(self._variables, x, strict=True)]
            found = self._misfit(np.array(numbers))
            if found is None:
                break
            slopes = self._best.slopes
            if found.derivatives is not None:
                slopes = found.derivatives * rates(self._variables, np.array(numbers))
            place = known = _Place(x, found.values, slopes)
        return place
