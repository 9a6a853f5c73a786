"""Least squares over numbers: errors, what is not determined, and trials without a solution."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from contact_locking.arrays import FloatArray
from contact_locking.errors import NotConverged
from contact_locking.inverse.fit.estimate import Residuals, Variable, estimate
from contact_locking.inverse.fit.session import about_residuals, undetermined

pytestmark = pytest.mark.serial

T: FloatArray = np.linspace(0.1, 3.0, 40, dtype=float)
NOISE = 0.01


def variable(key: str, start: float, is_log: bool = False, least: float = 0.0) -> Variable:
    return Variable(key, start, least, np.inf, is_log)


def saturating(data: FloatArray) -> Callable[[FloatArray], Residuals | None]:
    """``a (1 - exp(-b t))``, without a solution for b > 4."""

    def misfit(numbers: FloatArray) -> Residuals | None:
        a, b = numbers
        if b > 4.0:
            return None
        decay = np.exp(-b * T)
        slopes = np.array([1.0 - decay, a * T * decay]).T
        return Residuals((a * (1.0 - decay) - data) / NOISE, slopes / NOISE)

    return misfit


def measured(seed: int) -> FloatArray:
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(T))
    return np.asarray(2.0 * (1.0 - np.exp(-1.5 * T)) + noise)


@pytest.mark.parametrize("is_log", [True, False])
def test_numbers_lie_within_their_errors(is_log: bool) -> None:
    inside = []
    for seed in range(40):
        variables = [variable("a", 1.0, is_log), variable("b", 3.9, is_log)]
        found = estimate(variables, saturating(measured(seed)), has_errors=True, derives=True)
        assert found.converged and not found.at_bound
        inside += list(np.abs(found.numbers - (2.0, 1.5)) <= 2.0 * found.errors)
    # 95 % of normal deviations are within two standard errors.
    assert 0.88 <= np.mean(inside) <= 1.0


def test_errors_and_intervals_are_those_of_a_line() -> None:
    """``p t``: the standard error is ``s/|t|``, and 95 % are Student's quantile of it."""
    data = 3.0 * T + NOISE * np.random.default_rng(1).standard_normal(len(T))

    def misfit(numbers: FloatArray) -> Residuals:
        return Residuals(numbers[0] * T - data, T[:, None])

    found = estimate([variable("p", 1.0)], misfit, has_errors=False, derives=True)
    best = data @ T / (T @ T)
    spread = np.sqrt(np.sum((best * T - data) ** 2) / 39.0 / (T @ T))
    assert found.numbers[0] == pytest.approx(best, rel=1e-6)
    assert found.errors[0] == pytest.approx(spread, rel=1e-6)
    assert found.intervals[0] == pytest.approx(best + np.array([-1, 1]) * 2.0227 * spread, rel=1e-5)


def test_a_product_is_known_where_its_factors_are_not() -> None:
    """``a b t`` is determined by ``a b``."""
    data = 3.0 * T + NOISE * np.random.default_rng(2).standard_normal(len(T))

    def misfit(numbers: FloatArray) -> Residuals:
        a, b = numbers
        return Residuals((a * b * T - data) / NOISE, np.array([b * T, a * T]).T / NOISE)

    found = estimate([variable("a", 1.0), variable("b", 2.0)], misfit, True, True)
    assert np.prod(found.numbers) == pytest.approx(3.0, rel=1e-2)
    assert np.all(np.isinf(found.errors))
    assert undetermined(found, ["a", "b"]) == ["a^0.71 b^-0.71: the data do not depend on it"]


@pytest.mark.parametrize("seed", range(10))
def test_a_number_beyond_a_kink_of_the_misfit_has_one_bound(seed: int) -> None:
    """Friction ``min(mu, 0.19)``: above 0.19 nothing slips, and 0.35 made the data."""

    def forces(numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
        young, mu = numbers
        slips = np.minimum(mu, 0.19 + 1e-4 * np.tanh(mu - 0.19))
        slope = np.where(mu < 0.19, 1.0, 1e-4 / np.cosh(mu - 0.19) ** 2)
        values = np.concatenate([young * T, slips * young * T])
        by_young = np.concatenate([T, slips * T])
        return values, np.array([by_young, np.concatenate([0.0 * T, slope * young * T])]).T

    noise = NOISE * np.random.default_rng(seed).standard_normal(2 * len(T))
    data = forces(np.array([1.3, 0.35]))[0] + noise

    def misfit(numbers: FloatArray) -> Residuals:
        values, slopes = forces(numbers)
        return Residuals(np.asarray((values - data) / NOISE), np.asarray(slopes / NOISE))

    variables = [Variable("E", 1.0, 0.05, 20.0, True), Variable("mu", 0.1, 0.01, 2.0, False)]
    found = estimate(variables, misfit, has_errors=True, derives=True)
    low, high = found.intervals[1]
    assert 0.18 < low < 0.2 and math.isinf(high) and math.isinf(found.errors[1])
    (told,) = undetermined(found, ["E", "mu"])
    assert told.startswith("mu: at least 0.1")


def test_no_solution_at_the_start_is_an_error() -> None:
    variables = [variable("a", 1.0), variable("b", 5.0)]
    with pytest.raises(NotConverged, match="give another start"):
        estimate(variables, saturating(measured(5)), has_errors=True, derives=True)


def test_a_wrong_model_is_seen_by_the_signs_of_its_residuals() -> None:
    noise = np.random.default_rng(6).standard_normal(60)
    bent = np.linspace(-1.0, 1.0, 60) ** 2 - 0.33
    (told,) = about_residuals("force", bent, 10.0 * np.ones(60), None, 1.0)
    assert "change their sign 2 times, noise would do so about 30" in told
    assert about_residuals("force", noise, 50.0 * np.ones(60), None, 1.0) == []
    # What is below the tolerance of the solver is no noise.
    assert about_residuals("force", 1e-6 * bent, np.ones(60), None, 1.0) == []
