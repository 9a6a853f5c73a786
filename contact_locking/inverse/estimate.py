"""Least squares over numbers with bounds, and what the data tell of each of them.

With residuals ``r`` (m,) over their standard errors and ``J = dr/dx`` at the least squares, the
covariance of x is ``s^2 (J^T J)^-1``.  Without standard errors the residuals themselves tell
``s^2 = |r|^2/(m - n)``.  Searched are ``x = (p - p_0)/0.3 |p_0|``, or ``x = ln(p/p_0)/0.3`` with
a log scale, so that the first step changes the numbers by 30 % at most.

A strain limit above all strains, or a friction bound above all tractions, is a number that nothing
depends on any more, and just below them its derivatives are too small to tell how far to go.  So
a number whose influence has faded since the start is held while the others are searched.  At their
end it goes back some of the way to where it mattered, and all are searched if the misfit is smaller
there.

95 % intervals are judged by the misfit at their ends.  In the linear model the least squares over
all other numbers rise by ``q^2 s^2`` between their minimum and the end ``q e`` of an interval, with
Student's quantile q, the scatter s^2 and the standard error e.  A friction coefficient above which
everything sticks, or a limit above all strains, is beyond a kink of the misfit: there the misfit
hardly rises, and the interval reaches to where it does, or is open.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.errors import NotConverged

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
        x, residuals = self.x.copy(), right + self.slopes[:, others] @ steps
        x[number] = value
        x[others] += steps
        return np.clip(x, *bounds), float(residuals @ residuals)


@dataclass(frozen=True)
class _Intervals:
    """The intervals at the least squares, with Student's quantile and the scale s."""

    variables: Sequence[Variable]
    misfit: Misfit
    best: _Place
    quantile: float
    scale: float

    @property
    def _rise(self) -> float:
        return (self.quantile * self.scale) ** 2

    @property
    def _bounds(self) -> FloatArray:
        ends = [[v.searched(v.least), v.searched(v.largest)] for v in self.variables]
        return np.array(ends).T

    def of(self, number: int, error: float) -> tuple[float, float]:
        """The ends for a searched number with its standard error; infinite where it is open."""
        reach = self.quantile * error
        if not math.isfinite(self._rise) or reach <= _LEAST_ERROR:
            return self._numbers(number, -reach, reach)
        low, high = (self._end(number, side, reach) for side in (-1.0, 1.0))
        return self._numbers(number, -low, high)

    def _numbers(self, number: int, low: float, high: float) -> tuple[float, float]:
        variable, x = self.variables[number], float(self.best.x[number])
        ends = [variable.number(x + step) if math.isfinite(step) else step for step in (low, high)]
        return ends[0], ends[1]

    def _end(self, number: int, side: float, reach: float) -> float:
        """The distance of the end on one side: the reach, or more where the misfit is flat.

        An end that a bound excludes is searched within the reach.
        """
        far = self._far(number)
        bound = float(self._bounds[int(side > 0.0), number])
        farthest = min(side * (bound - float(self.best.x[number])), far)
        if farthest <= _LEAST_ERROR:
            return reach
        first, start = min(reach, farthest), self.best.misfit
        most = start + self._rise
        flat = start + _TOO_FLAT * self._rise * (first / reach) ** 2
        goal = most if first < reach else flat
        place = self._at(number, side * first, self.best, goal)
        misfit = math.inf if place is None else place.misfit
        is_beyond = misfit > most
        if misfit >= flat and not (is_beyond and first < reach):
            return reach if reach <= far else math.inf
        if is_beyond or place is None:
            place, low, high = self.best, _NEAREST * first, first
        else:
            low, high = first, farthest
            last = self._at(number, side * farthest, place, most)
            if first == farthest or (last is not None and last.misfit <= most):
                return math.inf
        for _ in range(_HALVINGS):
            if high <= _FACTOR * low:
                break
            middle = math.sqrt(low * high)
            trial = self._at(number, side * middle, place, most)
            if trial is not None and trial.misfit <= most:
                low, place = middle, trial
            else:
                high = middle
        # Only the bound itself is excluded, or the farthest number.
        return math.inf if high == farthest else high

    def _far(self, number: int) -> float:
        """The distance of a number that is many times as large or as small."""
        variable = self.variables[number]
        if variable.is_log:
            return abs(variable.searched(variable.start * _FARTHEST))
        size = abs(variable.number(float(self.best.x[number]))) or abs(variable.start) or 1.0
        return (_FARTHEST - 1.0) * size / variable.rate(size)

    def _at(self, number: int, distance: float, known: _Place, goal: float) -> _Place | None:
        """The least squares at a distance, as near as it takes to tell whether they reach a goal.

        ``known`` is a place near.  None where there is no solution.
        """
        value, place = float(self.best.x[number]) + distance, None
        for _ in range(1 + _CORRECTIONS):
            x, expected = known.predicted(number, value, self._bounds)
            if place is None and known is not self.best:
                # Beyond a kink the slopes before it lead the other numbers astray.
                x = known.x.copy()
                x[number] = value
            if place is not None and (place.misfit <= goal or expected > goal):
                break
            numbers = [v.number(float(at)) for v, at in zip(self.variables, x, strict=True)]
            residuals = self.misfit(np.array(numbers))
            if residuals is None:
                break
            slopes = self.best.slopes
            if residuals.derivatives is not None:
                slopes = residuals.derivatives * rates(self.variables, np.array(numbers))
            place = known = _Place(x, residuals.values, slopes)
        return place


# The search ends where the least squares are within so many standard errors of the numbers, which
# makes their errors larger by a thousandth.  Points that change their state bend the residuals:
# nearer to their end steps do not keep what the derivatives promise.
_OFFSET = 0.05
# Without noise it ends where a step changes the misfit by this share, or the numbers by this.
_FTOL, _XTOL = 1e-4, 1e-6
_MOST_EVALUATIONS = 60
# The share of its influence at the start at which a number is held.
_FADED = 0.05
# The shares of the way that a number goes back to where it mattered.
_SHARES = (0.5, 0.25, 0.125)
# A number has no influence if its derivatives are this share of the largest: a strain that is below
# its limit has a multiplier on the central path.
NO_INFLUENCE = 1e-5
# The width of forward differences, where there are no derivatives.
_WIDTH = 1e-3
# A combination is not determined whose logarithm has a larger standard error than this.
UNDETERMINED = 0.5


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

    Errors are infinite where the data do not have the number, and an end of an interval where they
    do not bound it.  ``combinations`` are from the best known to the least, ``at_bound`` the keys
    at a bound.  ``misfit`` is ``|r|^2``, ``scatter`` over ``m - n``, infinite for ``m = n`` unless
    standard errors are known.
    """

    numbers: FloatArray
    errors: FloatArray
    intervals: FloatArray
    correlation: FloatArray
    combinations: tuple[Combination, ...]
    at_bound: tuple[str, ...]
    misfit: float
    scatter: float
    converged: bool
    reason: str


class _Stopped(Exception):
    """The search is not to go on from the accepted numbers (n,), if need be with others held."""

    def __init__(self, numbers: FloatArray, is_end: bool) -> None:
        super().__init__()
        self.numbers, self.is_end = numbers, is_end


class _Trials:
    """The memory of the search: residuals at numbers, and how much these mattered at the start."""

    def __init__(self, misfit: Misfit, derives: bool) -> None:
        self._misfit, self._derives = misfit, derives
        self._known: dict[bytes, Residuals] = {}
        self._at_start: FloatArray | None = None
        self._nearest: FloatArray | None = None

    def residuals(self, numbers: FloatArray) -> FloatArray:
        """The residuals (m,), not finite where there are none.  Raises NotConverged at first."""
        residuals = self._misfit(numbers)
        if residuals is None:
            if not self._known or not self._derives:
                raise NotConverged(
                    "a solve did not converge at or near the start of the fit: give another start"
                )
            # The search takes a shorter step where nothing is finite.
            return np.full_like(next(iter(self._known.values())).values, np.nan)
        self._known[numbers.tobytes()] = residuals
        if self._at_start is None:
            self._at_start = influence(residuals, numbers)
        if not np.any(self.faded(numbers)):
            self._nearest = numbers
        return residuals.values

    def at(self, numbers: FloatArray) -> Residuals:
        return self._known[numbers.tobytes()]

    def faded(self, numbers: FloatArray) -> BoolArray:
        """Which numbers (n,) matter much less here than at the start."""
        assert self._at_start is not None
        sizes = influence(self.at(numbers), numbers)
        return np.asarray((sizes <= _FADED * self._at_start) & (self._at_start > NO_INFLUENCE))

    def beside(self, numbers: FloatArray, which: BoolArray) -> FloatArray | None:
        """Numbers (n,), of which some are nearer to where they mattered, with less misfit."""
        assert self._nearest is not None
        values = self.at(numbers).values
        for share in _SHARES if np.any(which) else ():
            back = numbers + share * (self._nearest - numbers)
            trial = np.where(which, back, numbers)
            beside = self.residuals(trial)
            # Comparisons with what is not finite are False.
            if float(beside @ beside) < float(values @ values):
                return trial
        return None


def estimate(
    variables: Sequence[Variable], misfit: Misfit, has_errors: bool, derives: bool
) -> Estimate:
    """The least squares, by SciPy's trust region method.

    ``has_errors`` says that the residuals are over known standard errors, ``derives`` that they
    come with derivatives.  Raises NotConverged if there is no solution at the start, or for
    a difference.
    """
    trials = _Trials(misfit, derives)
    at: FloatArray | None = np.array([variable.start for variable in variables])
    held: BoolArray = np.zeros(len(variables), dtype=bool)
    while at is not None:
        pairs = zip(variables, map(float, at), strict=True)
        variables = [dataclasses.replace(variable, start=start) for variable, start in pairs]
        try:
            end = _least_squares(variables, held, trials, derives)
            at = trials.beside(end[0], held)
        except _Stopped as stopped:
            at = stopped.numbers
        if at is not None:
            held = trials.faded(at)
    numbers, slopes, at_bound, converged, reason = end
    by_x, residuals = rates(variables, numbers), trials.at(numbers).values
    freedom = len(residuals) - len(variables)
    total = float(residuals @ residuals)
    scatter = total / freedom if freedom > 0 else (1.0 if has_errors else np.inf)
    # Known errors that are too small for the residuals do not make the numbers more certain.
    scale = float(np.sqrt(max(1.0, scatter) if has_errors else scatter))
    errors, correlation = _covariance(slopes, scale)
    quantile = float(student.ppf(0.975, freedom if freedom > 0 else np.inf))
    x = np.array([v.searched(value) for v, value in zip(variables, numbers, strict=True)])
    judged = _Intervals(variables, misfit, _Place(x, residuals, slopes), quantile, scale)
    intervals = np.array([judged.of(place, float(error)) for place, error in enumerate(errors)])
    # There is no standard error where the misfit is no parabola on one side.
    errors = np.where(np.isinf(intervals).any(axis=1), np.inf, errors)
    return Estimate(
        numbers,
        np.abs(errors * by_x),
        intervals,
        correlation,
        combinations(slopes / by_x * numbers, scale),
        tuple(v.key for v, side in zip(variables, at_bound, strict=True) if side),
        total,
        scatter,
        converged,
        reason,
    )


def _least_squares(
    variables: Sequence[Variable], held: BoolArray, trials: _Trials, derives: bool
) -> tuple[FloatArray, FloatArray, BoolArray, bool, str]:
    """The end of SciPy's search from the starts, where some stay.

    It has the numbers (n,), the slopes ``dr/dx`` (m, n), which are at a bound, whether the search
    converged, and why it ends.  Raises as trials, and _Stopped where other numbers have faded.
    """
    starts, free = np.array([v.start for v in variables]), np.flatnonzero(~held)
    moved = [variables[place] for place in free]

    def numbers_at(x: FloatArray) -> FloatArray:
        numbers = starts.copy()
        numbers[free] = [v.number(value) for v, value in zip(moved, x, strict=True)]
        return numbers

    def slopes_at(numbers: FloatArray) -> FloatArray:
        derivatives = trials.at(numbers).derivatives
        assert derivatives is not None
        return derivatives * rates(variables, numbers)

    def jacobian(x: FloatArray) -> FloatArray:
        numbers = numbers_at(x)
        slopes = slopes_at(numbers)[:, free]
        if np.any(trials.faded(numbers) != held):
            raise _Stopped(numbers, is_end=False)
        if offset(trials.at(numbers).values, slopes) <= _OFFSET:
            raise _Stopped(numbers, is_end=True)
        return slopes

    at_bound = np.zeros(len(variables), dtype=bool)
    try:
        result = least_squares(
            lambda x: trials.residuals(numbers_at(x)),
            np.zeros(len(free)),
            jac=jacobian if derives else "2-point",
            bounds=([v.searched(v.least) for v in moved], [v.searched(v.largest) for v in moved]),
            ftol=_FTOL,
            xtol=_XTOL,
            gtol=1e-12,
            max_nfev=_MOST_EVALUATIONS,
            diff_step=None if derives else _WIDTH,
        )
    except _Stopped as stopped:
        if not stopped.is_end:
            raise
        reason = f"the least squares are within {_OFFSET:g} standard errors"
        return stopped.numbers, slopes_at(stopped.numbers), at_bound, True, reason
    numbers = numbers_at(result.x)
    at_bound[free] = result.active_mask != 0
    slopes = slopes_at(numbers) if derives else np.asarray(result.jac)
    return numbers, slopes, at_bound, bool(result.status > 0), str(result.message)


def offset(residuals: FloatArray, slopes: FloatArray) -> float:
    """``sqrt(|Q^T r|^2/n)/s``: how far the least squares are, in standard errors of the numbers.

    Q (m, n) spans the slopes, and ``s^2 = |r - Q Q^T r|^2/(m - n)``.  Infinite without freedom.
    D. M. Bates and D. G. Watts, Technometrics 23 (1981), 179-183, have this criterion.
    """
    rows, count = slopes.shape
    if rows <= count:
        return np.inf
    step = np.linalg.lstsq(slopes, residuals, rcond=ROUNDING)[0]
    within = slopes @ step
    spread = np.linalg.norm(residuals - within) / np.sqrt(rows - count)
    size = float(np.linalg.norm(within) / np.sqrt(count))
    return size / float(spread) if spread > 0.0 else np.inf


def influence(residuals: Residuals, numbers: FloatArray) -> FloatArray:
    """The derivatives (n,) by logarithms over the largest of them; ones without derivatives."""
    if residuals.derivatives is None:
        return np.ones(len(numbers))
    size = np.linalg.norm(residuals.derivatives * numbers, axis=0)
    largest = float(size.max(initial=0.0))
    return np.asarray(size / largest) if largest > 0.0 else np.zeros(len(numbers))


def _singular(matrix: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Singular values (n,) of (m, n), the rows (n, n) of V^T, and which are more than rounding."""
    _, singular, rows = np.linalg.svd(matrix, full_matrices=True)
    size = np.pad(singular, (0, matrix.shape[1] - len(singular)))
    return size, rows, size > ROUNDING * size.max(initial=0.0)


def _covariance(slopes: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """Standard errors (n,) and correlations (n, n), by singular values."""
    size, rows, is_known = _singular(slopes)
    root = rows.T * np.divide(1.0, size, out=np.zeros_like(size), where=is_known)
    covariance = root @ root.T
    spread = np.sqrt(np.diag(covariance))
    errors, spread = scale * spread, np.where(spread > 0.0, spread, 1.0)
    lost = np.abs(rows[~is_known]).max(axis=0, initial=0.0) > np.sqrt(ROUNDING)
    return np.where(lost, np.inf, errors), covariance / np.outer(spread, spread)


def combinations(by_logarithms: FloatArray, scale: float) -> tuple[Combination, ...]:
    """The principal combinations of derivatives (m, n) by the logarithms of the numbers."""
    size, rows, known = _singular(by_logarithms)
    return tuple(
        Combination(rows[k], float(size[k]), scale / float(size[k]) if known[k] else np.inf)
        for k in range(len(size))
    )
