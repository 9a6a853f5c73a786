"""V51: foundations on springs, beside closed forms."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pressed_tools import NONE, told
from problems import column, solved
from verification_table import Rows

pytestmark = pytest.mark.serial

LAWS = [(math.inf, "auto"), (1e3, "interior_point")]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("n", "method"), LAWS)
@pytest.mark.parametrize("preload", [0.0, 0.01])
def test_a_spring_and_a_column_are_two_springs_in_series(
    dim: int, n: float, method: str, preload: float, found: Rows
) -> None:
    """``p + k q = F`` and ``p = S (raised + q - eps p)/height``."""
    raised, height, k, epsilon = 0.02, 2.0, 0.5, 1e-4
    stiffness = 0.3 / (1.3 * 0.4) + 2.0 / 2.6
    across = [0.0] * (dim - 1)
    spring: dict[str, Any] = {"stiffness": k}
    plane = {"point": [*across, height], "normal": [*across, -1.0]}
    foundation: dict[str, Any] = {"half_space": plane, "spring": spring}
    if preload:
        foundation["force"] = [*across, -preload]
    else:
        spring["along"] = [*across, 7.0]
    rollers = [item.model_dump() for item in column(dim).loads.displacements]
    stands = {"on": ["bottom"], "value": [None] * (dim - 1) + [raised]}
    state = solved(
        column(
            dim,
            contact={"on": "top", "foundation": foundation},
            friction={"coefficient": 0.0, "smoothing": NONE},
            loads={"displacements": [*rollers, stands]},
            material__locking_limit=math.inf,
            penalty={"n": n, "epsilon": epsilon},
            solver__method=method,
        )
    )
    per = stiffness / (height + stiffness * epsilon)
    travel = (preload - per * raised) / (k + per)
    where = f"column and spring, {dim}D, n = {n:g}, {method}, F = {preload:g}"
    found.add("V51", where, "travel", told(state)["travel"], travel, rel=1e-8)
    assert told(state)["spring_force"] == pytest.approx(-k * travel, rel=1e-8)
    assert state.summary["contact_force"][-1] == pytest.approx(k * travel - preload, rel=1e-8)
    assert state.summary["certificate"]["criteria"]["tool_balance"]["holds"]
