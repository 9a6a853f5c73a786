"""The load factor that a body can follow on any mesh: its bracket, beside exact factors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from problems import block, with_changes

from contact_locking.running import solving
from contact_locking.study_file.parameters import Parameters


def pulled_l_shape(h: float, move: float) -> Parameters:
    """An L-shape with a clamped top and a right side that moves up, without contact."""
    return with_changes(
        {
            "mesh": {"builder": "l_shape", "h": h},
            "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02},
            "loads": {
                "displacements": [
                    {"on": "top", "value": [0.0, 0.0]},
                    {"on": "right", "value": [0.0, move]},
                ]
            },
            "contact": {"on": []},
            "certificate": {"error_bound": True},
        }
    )


@pytest.mark.serial
def test_what_a_coarse_mesh_cannot_follow_is_not_said_to_be_impossible_for_the_body() -> None:
    coarse, fine = (solving.solve(pulled_l_shape(h, 0.03)).summary for h in (0.5, 0.25))
    assert not coarse["converged"] and "of this mesh" in coarse["reason"]
    assert fine["converged"]
    brackets = []
    for summary in (coarse, fine):
        found = summary["certificate"]["limit_load"]
        assert found["infeasible"] is False
        brackets.append(found["load_factor"])
    confirmed, excluded = np.transpose(brackets)
    # The bracket of either mesh is one of the body: no lower end exceeds an upper end.
    assert confirmed.max() < excluded.min()
    assert excluded[0] < 1.8 and excluded[1] < 1.5


def test_displacements_that_are_too_large_for_every_mesh_are_proved_so() -> None:
    summary = solving.solve(pulled_l_shape(0.25, 0.06)).summary
    found = summary["certificate"]["limit_load"]
    assert found["infeasible"] is True
    assert 0.4 < found["load_factor"][0] < found["load_factor"][1] < 0.75


def test_the_limit_load_of_a_stretched_bar_is_exact() -> None:
    # |eps| = M for a stretch of M = 0.02 without lateral strain.
    sides = [{"on": ["bottom", "top"], "value": [None, 0.0]}]
    ends = [{"on": "left", "value": [0.0, None]}, {"on": "right", "value": [0.03, None]}]
    stretched = block(
        h=0.5,
        loads={"displacements": sides + ends},
        contact={"on": []},
        penalty__n=math.inf,
        certificate__error_bound=True,
    )
    found = solving.solve(stretched).summary["certificate"]["limit_load"]
    assert found["infeasible"] is True
    assert found["load_factor"][1] == pytest.approx(2.0 / 3.0, rel=1e-6)
