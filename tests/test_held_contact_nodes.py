"""Nodes that Gamma_C shares with the part of the boundary that is held: no contact acts there."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from problems import block

from contact_locking import Solution, solve

_PUSH = -0.02


def _clamped_at_the_side(n: float) -> Solution:
    """A block that is clamped on its left, with a plate on top that a force pushes down."""
    contact: dict[str, Any] = {
        "on": "top",
        "foundation": {
            "half_space": {"point": [0.0, 1.0], "normal": [0.0, -1.0]},
            "force": [0.0, _PUSH],
        },
        "friction": {"coefficient": 0.5, "smoothing": {"kernel": "none"}},
    }
    loads = {"displacements": [{"on": "left", "value": [0.0, 0.0]}]}
    found = solve(block(h=0.25, loads=loads, contact=contact, penalty__n=n))
    assert found.converged, found.summary["reason"]
    return found


@pytest.mark.parametrize("n", [100.0, 1e4, math.inf])
def test_the_forces_that_are_told_balance_a_tool_over_a_held_corner(n: float) -> None:
    found = _clamped_at_the_side(n)
    entry = found.summary["contacts"][0]
    total = np.add(entry["contact_force"], entry["friction_force"])
    assert total[1] == pytest.approx(_PUSH, rel=1e-6)
    assert found.summary["reactions"]["left"][1] == pytest.approx(-_PUSH, rel=1e-6)
    fields = found.contacts[0]
    is_held = ~fields.free
    assert np.all(fields.pressure[is_held] == 0.0)
    assert np.all(fields.traction[is_held] == 0.0)


@pytest.mark.parametrize("n", [1e4, math.inf])
def test_a_tool_that_enters_a_held_corner_is_warned_of(n: float) -> None:
    found = _clamped_at_the_side(n)
    (warning,) = (text for text in found.summary["warnings"] if "holds" in text)
    assert warning.startswith("contact: the foundation enters the body by ")
    assert "where no contact acts" in warning
