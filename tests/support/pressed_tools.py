"""A block that tools press with given forces."""

from __future__ import annotations

import math
from typing import Any

from problems import block

from contact_locking import Parameters, StudySolution

NONE = {"kernel": "none"}
HELD = [{"on": "bottom", "value": [0.0, 0.0]}]
UP = {"point": [0.0, 1.0], "normal": [0.0, -1.0]}


def tool(force: list[Any], on: str = "top", mu: float = 0.3, **shape: Any) -> dict[str, Any]:
    """A contact whose foundation, by default a plane above a unit block, is pushed by a force."""
    friction = {"coefficient": mu, "smoothing": NONE}
    return {
        "on": on,
        "foundation": {**(shape or {"half_space": UP}), "force": force},
        "friction": friction,
    }


def pressed(contact: Any, n: float = math.inf, **changes: Any) -> Parameters:
    """A unit block that stands on its clamped bottom, with a load on its right."""
    loads = {"tractions": [{"on": "right", "value": [-0.01, 0.003]}], "displacements": HELD}
    given: dict[str, Any] = {"h": 0.34, "loads": loads, "penalty__n": n, "contact": contact}
    return block(**(given | changes))


def told(solution: StudySolution, number: int = 0) -> dict[str, Any]:
    """The entry of the summary about a tool."""
    return dict(solution.summary["contacts"][number]["tool"])
