"""A block that is pressed and sheared in steps, for tests of processes."""

from __future__ import annotations

import math
from typing import Any

from problems import block

from contact_locking import Parameters, solve_steps
from contact_locking.results.solution import StudySolution

SHEARED = ["0.02*sin(2*pi*t)", "-0.02*min(8*t, 1)"]


def sheared(count: int = 8, to: float = 1.0, **changes: Any) -> Parameters:
    """A block that is pressed during an eighth of a cycle, and sheared to and fro all the time."""
    given: dict[str, Any] = {
        "h": 0.25,
        "loads": {"displacements": [{"on": "top", "value": SHEARED}]},
        "steps": {"to": to, "count": count},
        "material__locking_limit": 0.04,
        "penalty__n": math.inf,
    }
    return block(**(given | changes))


def all_of(parameters: Parameters) -> list[StudySolution]:
    solutions = list(solve_steps(parameters))
    assert all(found.converged for found in solutions), solutions[-1].summary["reason"]
    return solutions
