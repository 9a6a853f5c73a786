"""A small block under pressures."""

from __future__ import annotations

import math
from typing import Any

import pytest
from problems import block

from contact_locking import Parameters

BOTH_DEGREES = pytest.mark.parametrize("degree", [1, 2])


def square(**changes: Any) -> Parameters:
    """A small block on a foundation with friction, clamped on the right."""
    given: dict[str, Any] = {
        "h": 0.25,
        "mesh__structured": True,
        "material__locking_limit": 0.05,
        "penalty__n": math.inf,
        "loads": {
            "pressures": [{"on": "top", "value": "0.04 + 0.02*x"}, {"on": "left", "value": -0.01}],
            "displacements": [{"on": "right", "value": [0, 0]}],
        },
    }
    return block(**(given | changes))
