"""The penalties that warnings advise do what the warnings say of them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import pytest
from problems import block
from slow import slow

from contact_locking import solve

pytestmark = pytest.mark.serial


def solved(**penalty: Any) -> tuple[Mapping[str, Any], float]:
    """The summary of the block, and its largest displacement."""
    solution = solve(block(h=0.25, material__locking_limit=0.02, **penalty))
    assert solution.converged, solution.summary["reason"]
    return solution.summary, float(abs(solution.displacement.x.array).max())


def advised(summary: Mapping[str, Any], key: str) -> float:
    """The value of a key in the one warning that names the key."""
    (warning,) = [text for text in summary["warnings"] if f"{key}: " in text]
    found = re.search(rf"{key}: (\S+) leaves about 1 %", warning)
    assert found is not None, warning
    return float(found[1])


@pytest.mark.parametrize("n", [0.1, slow(3.0)])
def test_the_advised_n_leaves_a_per_cent_of_overstrain(n: float) -> None:
    hard = {"penalty__epsilon": 1e-6}
    summary, _ = solved(penalty__n=n, **hard)
    assert summary["strain_norm_max"] > 0.02 * 1.1
    better, _ = solved(penalty__n=advised(summary, "penalty.n"), **hard)
    assert better["strain_norm_max"] <= 0.02 * 1.03
    assert not any("penalty.n" in text for text in better["warnings"])


@pytest.mark.parametrize("epsilon", [slow(0.3), 10.0])
def test_the_advised_epsilon_leaves_a_per_cent_of_penetration(epsilon: float) -> None:
    summary, size = solved(penalty__n=math.inf, penalty__epsilon=epsilon)
    assert summary["penetration_max"] > 0.1 * size
    better, size = solved(penalty__n=math.inf, penalty__epsilon=advised(summary, "penalty.epsilon"))
    assert better["penetration_max"] <= 0.03 * size
    assert not any("penalty.epsilon" in text for text in better["warnings"])
