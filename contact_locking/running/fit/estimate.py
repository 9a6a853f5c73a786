"""Least squares over numbers with bounds, and what the data tell of each of them.

With residuals ``r`` (m,) over their standard errors and ``J = dr/dx`` at the least squares, the
covariance of x is ``s^2 (J^T J)^-1``.  Without standard errors the residuals themselves tell
``s^2 = |r|^2/(m - n)``.  Searched are ``x = (p - p_0)/0.3 |p_0|``, or ``x = ln(p/p_0)/0.3`` with
a log scale, so that the first step changes the numbers by 30 % at most.

A strain limit above all strains, or a friction bound above all tractions, is a number that nothing
depends on any more: from there the search would not come back.  So a number that matters at the
start has to matter at each step.  Where a step leads to where it does not, the other numbers take
the step, this one half of it or less, and the search begins anew if the misfit is smaller there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.errors import NotConverged

# The search ends where a step changes the misfit by this share, which is a hundredth of a standard
# error of the numbers, or the numbers by this.
_FTOL, _XTOL = 1e-4, 1e-6
_MOST_EVALUATIONS = 60
# The change of the numbers that is 1 to the search, and so the longest first step.
_UNIT = 0.3
# The shares of a step that a number takes whose step leads to where it does not matter.
_SHARES = (0.5, 0.25, 0.125)
# A number has no influence if its derivatives are this share of the largest: a strain that is below
# its limit has a multiplier on the central path.
NO_INFLUENCE = 1e-5
# The width of forward differences, where there are no derivatives.
_WIDTH = 1e-3
# A combination is not determined whose logarithm has a larger standard error than this.
UNDETERMINED = 0.5
# Singular values below this share of the largest are rounding, and the end of a central path.
_ROUNDING = 1e-7


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


@dataclass(frozen=True)
class Combination:
    """A product of powers of the numbers, ``powers`` (n,) of unit length, with its accuracy.

    ``error`` is the standard error of its logarithm, infinite if the data do not have it at all.
    """

    powers: FloatArray
    singular: float
    error: float


@dataclass(frozen=True)
class Estimate:
    """The numbers (n,) of least squares, with standard errors, intervals and correlations.

    Errors are infinite where the data do not have the number.  ``combinations`` are from the best
    known to the least, ``at_bound`` the keys at a bound and ``lost`` those that steps went to
    where they do not matter.  ``misfit`` is ``|r|^2``, ``scatter`` over ``m - n``.
    """

    numbers: FloatArray
    errors: FloatArray
    intervals: FloatArray
    correlation: FloatArray
    combinations: tuple[Combination, ...]
    at_bound: tuple[str, ...]
    lost: tuple[str, ...]
    misfit: float
    scatter: float
    converged: bool
    reason: str


class _Lost(Exception):
    """A step has come to numbers (n,) where some, ``which`` (n,), have no influence any more."""

    def __init__(self, numbers: FloatArray, which: BoolArray) -> None:
        super().__init__()
        self.numbers, self.which = numbers, which


class _Trials:
    """The memory of the search: the residuals at numbers, and where numbers ceased to matter."""

    def __init__(self, keys: Sequence[str], misfit: Misfit, derives: bool) -> None:
        self._keys, self._misfit, self._derives = keys, misfit, derives
        self.known: dict[bytes, Residuals] = {}
        self.lost: set[str] = set()
        self._mattering: BoolArray = np.zeros(len(keys), dtype=bool)
        self._best: tuple[float, FloatArray] | None = None
        self._begins_anew = True

    def residuals(self, numbers: FloatArray) -> FloatArray:
        """The residuals (m,), not finite where there are none.  Raises NotConverged and _Lost."""
        found = self._misfit(numbers)
        if found is None:
            if self._best is None or not self._derives:
                raise NotConverged(
                    "a solve did not converge at the start of the fit, or beside it: give another "
                    "start"
                )
        else:
            gone = idle(found, numbers)
            if self._best is None:
                self._mattering = ~gone
            gone &= self._mattering
            if not np.any(gone):
                return self._take(found, numbers)
            self.lost.update(key for key, is_gone in zip(self._keys, gone, strict=True) if is_gone)
            if self._begins_anew:
                raise _Lost(numbers, gone)
        # The search takes a shorter step where nothing is finite.
        return np.full_like(next(iter(self.known.values())).values, np.nan)

    def _take(self, found: Residuals, numbers: FloatArray) -> FloatArray:
        self.known[numbers.tobytes()] = found
        size = float(found.values @ found.values)
        if self._best is None or size < self._best[0]:
            self._best = size, numbers
        return found.values

    def beside(self, lost: _Lost) -> FloatArray:
        """Numbers (n,) near a step whose lost numbers matter, with less misfit than all others.

        The best numbers so far if there are none: from then on steps are taken shorter.
        """
        assert self._best is not None
        size, best = self._best
        for share in _SHARES:
            numbers = np.where(lost.which, best + share * (lost.numbers - best), lost.numbers)
            self._begins_anew = False
            found = self.residuals(numbers)
            self._begins_anew = True
            if np.all(np.isfinite(found)) and float(found @ found) < size:
                return numbers
        self._begins_anew = False
        return best


def estimate(
    variables: Sequence[Variable], misfit: Misfit, has_errors: bool, derives: bool
) -> Estimate:
    """The least squares, by SciPy's trust region method.

    ``has_errors`` says that the residuals are over known standard errors, ``derives`` that they
    come with derivatives.  Raises NotConverged if there is no solution at the start, or for
    a difference.
    """
    trials = _Trials([variable.key for variable in variables], misfit, derives)
    while True:
        try:
            found = _least_squares(variables, trials, derives)
            break
        except _Lost as lost:
            starts = map(float, trials.beside(lost))
            pairs = zip(variables, starts, strict=True)
            variables = [dataclasses.replace(variable, start=at) for variable, at in pairs]
    numbers, rates = _numbers(variables, found.x), _rates(variables, found.x)
    slopes = np.asarray(found.jac)
    freedom = len(found.fun) - len(variables)
    total = float(found.fun @ found.fun)
    scatter = total / freedom if freedom > 0 else (1.0 if has_errors else np.inf)
    # Known errors that are too small for the residuals do not make the numbers more certain.
    scale = float(np.sqrt(max(1.0, scatter) if has_errors else scatter))
    errors, correlation = _covariance(slopes, scale)
    quantile = float(student.ppf(0.975, freedom)) if freedom > 0 else np.inf
    intervals = np.array(
        [
            [v.number(x - quantile * error), v.number(x + quantile * error)]
            for v, x, error in zip(variables, found.x, errors, strict=True)
        ]
    )
    return Estimate(
        numbers,
        np.abs(errors * rates),
        intervals,
        correlation,
        combinations(slopes / rates * numbers, scale),
        tuple(v.key for v, side in zip(variables, found.active_mask, strict=True) if side),
        tuple(sorted(trials.lost)),
        total,
        scatter,
        bool(found.status > 0),
        str(found.message),
    )


def _numbers(variables: Sequence[Variable], x: FloatArray) -> FloatArray:
    return np.array([v.number(value) for v, value in zip(variables, x, strict=True)])


def _rates(variables: Sequence[Variable], x: FloatArray) -> FloatArray:
    numbers = _numbers(variables, x)
    return np.array([v.rate(value) for v, value in zip(variables, numbers, strict=True)])


def _least_squares(variables: Sequence[Variable], trials: _Trials, derives: bool) -> Any:
    """SciPy's result of the search from the starts.  Raises as the trials."""

    def jacobian(x: FloatArray) -> FloatArray:
        found = trials.known[_numbers(variables, x).tobytes()].derivatives
        assert found is not None
        return found * _rates(variables, x)

    return least_squares(
        lambda x: trials.residuals(_numbers(variables, x)),
        [v.searched(v.start) for v in variables],
        jac=jacobian if derives else "2-point",
        bounds=(
            [v.searched(v.least) for v in variables],
            [v.searched(v.largest) for v in variables],
        ),
        ftol=_FTOL,
        xtol=_XTOL,
        gtol=1e-12,
        max_nfev=_MOST_EVALUATIONS,
        diff_step=None if derives else _WIDTH,
    )


def idle(found: Residuals, numbers: FloatArray) -> BoolArray:
    """Which numbers (n,) the residuals do not depend on; none without derivatives."""
    if found.derivatives is None:
        return np.zeros(len(numbers), dtype=bool)
    size = np.linalg.norm(found.derivatives * numbers, axis=0)
    return np.asarray(size <= NO_INFLUENCE * size.max(initial=0.0))


def _covariance(slopes: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """Standard errors (n,) and correlations (n, n), by singular values."""
    _, singular, rows = np.linalg.svd(slopes, full_matrices=True)
    size = np.zeros(slopes.shape[1])
    size[: len(singular)] = singular
    is_known = size > _ROUNDING * size.max(initial=0.0)
    inverse = np.where(is_known, 1.0 / np.where(is_known, size, 1.0), 0.0)
    root = rows.T * inverse
    covariance = root @ root.T
    errors = scale * np.sqrt(np.diag(covariance))
    spread = np.where(errors > 0.0, np.sqrt(np.diag(covariance)), 1.0)
    lost = np.abs(rows[~is_known]).max(axis=0, initial=0.0) > np.sqrt(_ROUNDING)
    return np.where(lost, np.inf, errors), covariance / np.outer(spread, spread)


def combinations(by_logarithms: FloatArray, scale: float) -> tuple[Combination, ...]:
    """The principal combinations of derivatives (m, n) by the logarithms of the numbers."""
    _, singular, rows = np.linalg.svd(by_logarithms, full_matrices=True)
    size = np.zeros(by_logarithms.shape[1])
    size[: len(singular)] = singular
    least = _ROUNDING * size.max(initial=0.0)
    return tuple(
        Combination(row, float(value), scale / float(value) if value > least else np.inf)
        for row, value in zip(rows, size, strict=True)
    )
