"""Least squares over numbers: errors, what is not determined, and trials without a solution."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from contact_locking.arrays import FloatArray
from contact_locking.errors import NotConverged
from contact_locking.inverse.fit import words
from contact_locking.inverse.fit.estimate import estimate
from contact_locking.inverse.fit.starts import starts_of
from contact_locking.inverse.fit.variables import Residuals, Variable

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


def test_differences_take_the_place_of_derivatives() -> None:
    misfit = saturating(measured(3))

    def without(numbers: FloatArray) -> Residuals | None:
        found = misfit(numbers)
        return found and Residuals(found.values, None)

    variables = [variable("a", 1.0), variable("b", 1.0)]
    derived = estimate(variables, misfit, has_errors=True, derives=True)
    found = estimate(variables, without, has_errors=True, derives=False)
    np.testing.assert_allclose(found.numbers, derived.numbers, rtol=1e-3)
    np.testing.assert_allclose(found.errors, derived.errors, rtol=1e-2)


def test_a_product_is_known_where_its_factors_are_not() -> None:
    """``a b t`` is determined by ``a b``."""
    data = 3.0 * T + NOISE * np.random.default_rng(2).standard_normal(len(T))

    def misfit(numbers: FloatArray) -> Residuals:
        a, b = numbers
        return Residuals((a * b * T - data) / NOISE, np.array([b * T, a * T]).T / NOISE)

    found = estimate([variable("a", 1.0), variable("b", 2.0)], misfit, True, True)
    assert np.prod(found.numbers) == pytest.approx(3.0, rel=1e-2)
    assert np.all(np.isinf(found.errors))
    assert words.undetermined(found, ["a", "b"]) == ["a^0.71 b^-0.71: the data do not depend on it"]
    start = np.array([1.0, 2.0])
    (told,) = words.before(misfit(start), start, ["a", "b"], "")
    assert told == "a^0.71 b^-0.71: the data do not determine it at the start"


def test_a_number_of_no_influence_is_told_before_the_search() -> None:
    at_start = Residuals(T, np.array([T, 1e-9 * T]).T)
    keys = ["material.elasticity.young", "material.locking_limit"]
    (told,) = words.before(at_start, np.array([1.0, 1.0]), keys, "")
    assert told.startswith("material.locking_limit: the measured quantities do not depend")


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
    (told,) = words.undetermined(found, ["E", "mu"])
    assert told.startswith("mu: at least 0.1")


def test_the_search_does_not_leave_what_matters() -> None:
    """A stiffening ``max(t - m, 0)^2`` that a step to a large m would lose."""
    data = T + np.maximum(T - 1.0, 0.0) ** 2

    def misfit(numbers: FloatArray) -> Residuals:
        young, limit = numbers
        over = np.maximum(T - limit, 0.0)
        slopes = np.array([T + over**2, -2.0 * young * over], dtype=float).T
        return Residuals(young * (T + over**2) - data, slopes)

    trials: set[tuple[float, ...]] = set()

    def counted(numbers: FloatArray) -> Residuals:
        trials.add(tuple(numbers))
        return misfit(numbers)

    variables = [variable("E", 10.0), variable("m", 2.5)]
    found = estimate(variables, counted, has_errors=False, derives=True)
    np.testing.assert_allclose(found.numbers, (1.0, 1.0), rtol=1e-4)
    # The modulus takes the steps that lead the limit to where it does not matter.
    assert any(m > T.max() for _, m in trials) and len(trials) <= 18


def test_searches_begin_all_over_the_bounds() -> None:
    one = Variable("E", 2.0, 0.1, 100.0, is_log=True)
    other = Variable("m", 0.3, 0.0, 1.0, is_log=False)
    starts = starts_of([one, other, variable("f", -1.0, least=-np.inf)], 11)
    assert starts.shape == (11, 3)
    np.testing.assert_array_equal(starts[0], (2.0, 0.3, -1.0))
    decades = np.sort(np.log(starts[1:, 0] / 0.1) / np.log(1000.0))
    np.testing.assert_array_equal(np.floor(10.0 * decades), np.arange(10))
    np.testing.assert_array_equal(np.floor(10.0 * np.sort(starts[1:, 1])), np.arange(10))
    assert np.all((starts[:, 2] >= -2.0) & (starts[:, 2] <= 0.0))


def test_searches_that_end_elsewhere_are_told() -> None:
    rows = [{"misfit": misfit} for misfit in (1.0, 1.001, 3.0, None)]
    assert words.about_starts(rows[:2], 1.0) == []
    (told,) = words.about_starts(rows, 1.0)
    assert told.startswith("2 of 4 searches ended at the least misfit, 1 at other numbers")
    assert told.endswith("1 without a solution")


def test_a_number_ends_at_its_bound() -> None:
    variables = [variable("a", 3.0, least=2.5), variable("b", 1.0)]
    found = estimate(variables, saturating(measured(4)), has_errors=True, derives=True)
    assert found.at_bound == ("a",) and found.numbers[0] == pytest.approx(2.5)


def test_no_solution_at_the_start_is_an_error() -> None:
    variables = [variable("a", 1.0), variable("b", 5.0)]
    with pytest.raises(NotConverged, match="give another start"):
        estimate(variables, saturating(measured(5)), has_errors=True, derives=True)


def test_a_wrong_model_is_seen_by_the_signs_of_its_residuals() -> None:
    noise = np.random.default_rng(6).standard_normal(60)
    assert abs(words.runs_of(noise)[0]) < 2.6
    bent = np.linspace(-1.0, 1.0, 60) ** 2 - 0.33
    (told,) = words.about_residuals("force", bent, 10.0 * np.ones(60), None, 1.0)
    assert "change their sign 2 times, noise would do so about" in told
    assert words.about_residuals("force", noise, 50.0 * np.ones(60), None, 1.0) == []
    # What is below the tolerance of the solver is no noise.
    assert words.about_residuals("force", 1e-6 * bent, np.ones(60), None, 1.0) == []


def test_residuals_above_their_errors_are_told() -> None:
    noise: FloatArray = 3.0 * np.random.default_rng(6).standard_normal(60)
    ones = np.ones(60)
    (told,) = words.about_residuals("force", noise, 50.0 * ones, ones, 1.0)
    assert "times their standard errors" in told
    assert words.about_residuals("force", np.asarray(noise / 3.0), 50.0 * ones, ones, 1.0) == []


def test_units_that_do_not_belong_together_are_told() -> None:
    (told,) = words.about_units("force", np.array([0.0, 3e5]), np.array([0.1, 0.2]))
    assert "the largest of the data is 3e+05, and the model has 0.2" in told
    assert words.about_units("force", np.array([3.0]), np.array([0.1])) == []
    (told,) = words.about_units("force", np.array([3.0]), np.array([0.0]))
    assert "does the body touch?" in told
    (told,) = words.about_units("force", np.array([1.0, 3.0]), np.array([-0.5, -2.0]))
    assert "opposite signs" in told
