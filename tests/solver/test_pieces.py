"""Newton's method on the pieces of the laws: its steps, their number, and where it gives up."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from contact_locking import Parameters
from contact_locking.running import solving


def _block(**changes: Any) -> Parameters:
    study: dict[str, Any] = {
        "mesh": {"builder": "block", "h": 0.1, "structured": True},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
        "loads": {
            "tractions": [{"on": "top", "value": [0.03, -0.05]}],
            "displacements": [{"on": "left", "value": [0.0, 0.0]}],
        },
        "contact": {"on": "bottom"},
        "friction": {"coefficient": 0.3, "smoothing": {"kernel": "none"}},
    }
    return Parameters.model_validate(study | changes)


def test_an_elastic_body_with_friction_takes_few_tangents_to_the_same_solution() -> None:
    found = solving.solve(_block())
    # Multigrid leaves the solve to the interior point method.
    other = solving.solve(_block(solver={"linear": "iterative"}))
    assert found.converged and other.converged
    # The first tangent is the elastic one.
    assert 1 < found.summary["iterations"]["tangents"] <= 9
    assert found.summary["iterations"]["tangents"] < other.summary["iterations"]["tangents"]
    u, v = found.displacement.x.array, other.displacement.x.array
    assert found.domain.comm.allreduce(float(np.sum((u - v) ** 2))) <= 1e-12 * (
        found.domain.comm.allreduce(float(np.sum(v**2)))
    )


@pytest.mark.parametrize("n", [math.inf, 1e4])
def test_steps_go_on_from_the_locked_cells_of_the_last(n: float) -> None:
    material = {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02}
    tractions = [{"on": "top", "value": ["0.03*(1 + 0.1*t)", -0.05]}]
    loads = {"tractions": tractions, "displacements": [{"on": "left", "value": [0.0, 0.0]}]}
    study = _block(
        material=material,
        loads=loads,
        steps={"to": 1.0, "count": 4},
        penalty={"n": n},
        friction={"coefficient": 0.3},
    )
    steps = list(solving.solve_steps(study))
    assert all(step.converged for step in steps)
    first, *later = (step.summary["iterations"]["tangents"] for step in steps)
    assert np.mean(later) <= 8.0 and np.mean(later) < first
