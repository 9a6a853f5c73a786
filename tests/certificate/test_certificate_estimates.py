"""Error estimates beside known distances, and the penalties that warnings advise."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from certified import certificate
from problems import block, column, solved, under_a_plate
from slow import slow

from contact_locking import solve

pytestmark = pytest.mark.serial


@pytest.mark.parametrize(
    "changes", [slow({"friction__coefficient": 0.0}), slow({"contact__gap": 0.002}), {}]
)
def test_the_bound_on_the_distance_to_the_inequality_holds(changes: dict[str, Any]) -> None:
    before = math.inf
    for n in (1e2, 1e4, 1e6):
        errors = certificate(block(penalty__n=n, certificate__limit=True, **changes))["errors"]
        bound, measured = errors["penalty"], errors["penalty_measured"]
        for key in ("energy_norm", "relative", "displacement_norm"):
            assert 0.0 < measured[key] <= bound[key]
        # eta^2 is of the order 1/n.
        assert bound["energy_norm"] < 0.3 * before
        before = bound["energy_norm"]


def test_the_solution_of_the_inequality_is_at_no_distance_from_itself() -> None:
    errors = certificate(block(penalty__n=math.inf, certificate__limit=True))["errors"]
    assert errors["penalty"]["energy_norm"] == 0.0
    assert errors["penalty_measured"]["relative"] <= 1e-7


def test_the_distance_of_a_column_is_that_of_its_exact_solutions() -> None:
    # Without locking both columns have the same strain, and the penalised one has sunk further.
    found = certificate(column(pressure=0.01, certificate__limit=True))["errors"]
    assert found["penalty_measured"]["relative"] <= 1e-7
    locked = certificate(column(pressure=0.05, certificate__limit=True))["errors"]
    k = 1.3461538461538463
    excess = (0.05 - k * 0.02) / (k + 2e3)
    exact = math.sqrt(k * 2.0) * excess
    assert locked["penalty_measured"]["energy_norm"] == pytest.approx(exact, rel=1e-5)
    assert locked["penalty"]["energy_norm"] >= exact


def test_where_no_admissible_field_is_found_the_bound_is_left_open_with_the_reason() -> None:
    penalty = certificate(under_a_plate(0.019))["errors"]["penalty"]
    assert penalty["energy_norm"] is None and "locking limit" in penalty["reason"]


@pytest.mark.parametrize("dim", [2, 3])
def test_the_indicator_vanishes_for_a_solution_that_is_exact(dim: int) -> None:
    solution = solved(column(dim))
    assert solution.error_indicator is not None
    assert np.abs(solution.error_indicator.x.array).max() <= 1e-7
    assert solution.summary["certificate"]["errors"]["mesh"]["with_locking"] <= 1e-7


def told_of(**penalty: Any) -> tuple[Mapping[str, Any], float]:
    """The summary of the block, and its largest displacement."""
    solution = solve(block(h=0.25, material__locking_limit=0.02, **penalty))
    assert solution.converged, solution.summary["reason"]
    return solution.summary, float(abs(solution.displacement.x.array).max())


def advised(summary: Mapping[str, Any], key: str) -> float:
    """The value of a key in the one warning that names the key."""
    (warning,) = [text for text in summary["warnings"] if f"{key}: " in text]
    found = re.search(rf"{key}: (\S+) reduces ", warning)
    assert found is not None, warning
    return float(found[1])


@pytest.mark.parametrize("n", [0.1, slow(3.0)])
def test_the_advised_n_leaves_a_per_cent_of_overstrain(n: float) -> None:
    hard = {"penalty__epsilon": 1e-6}
    summary, _ = told_of(penalty__n=n, **hard)
    assert summary["strain_norm_max"] > 0.02 * 1.1
    better, _ = told_of(penalty__n=advised(summary, "penalty.n"), **hard)
    assert better["strain_norm_max"] <= 0.02 * 1.03
    assert not any("penalty.n" in text for text in better["warnings"])


@pytest.mark.parametrize("epsilon", [slow(0.3), 10.0])
def test_the_advised_epsilon_leaves_a_per_cent_of_penetration(epsilon: float) -> None:
    summary, size = told_of(penalty__n=math.inf, penalty__epsilon=epsilon)
    assert summary["penetration_max"] > 0.1 * size
    better, size = told_of(
        penalty__n=math.inf, penalty__epsilon=advised(summary, "penalty.epsilon")
    )
    assert better["penetration_max"] <= 0.03 * size
    assert not any("penalty.epsilon" in text for text in better["warnings"])
