"""The certificate's error estimates, against distances and solutions that are known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from certified import certificate
from problems import block, column, solved, under_a_plate
from slow import slow

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
