"""Rough linear solves at the start, where values only move the body, and in proofs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI
from problems import block, solved

from contact_locking.running.assembly import assemble
from contact_locking.running.solving import SolvableStudy
from contact_locking.solver.interior_point import judge
from contact_locking.solver.interior_point.iterate import Iterate
from contact_locking.study_file import from_mapping

_ANGLE = 1e-3


@pytest.mark.parametrize(
    "value",
    [[0.3, 0.0], [f"-{_ANGLE}*y", f"{_ANGLE}*x"], [0.3, -0.1, 0.0]],
    ids=["shifted", "turned", "shifted in space"],
)
def test_a_body_that_is_moved_rigidly_along_the_foundation_takes_one_tangent_by_gmres(
    value: list[float | str],
) -> None:
    dim = len(value)
    moved = block(
        dim,
        0.2,
        loads={"displacements": [{"on": "left", "value": value}]},
        penalty__n=math.inf,
        solver__linear="iterative",
    )
    solution = solved(moved)
    assert solution.summary["iterations"]["tangents"] == 1
    space = solution.displacement.function_space
    x = space.tabulate_dof_coordinates()
    expected = np.zeros((len(x), dim))
    if isinstance(value[0], str):
        expected[:, 0], expected[:, 1] = -_ANGLE * x[:, 1], _ANGLE * x[:, 0]
    else:
        expected[:] = value
    assert np.abs(solution.displacement.x.array - expected.reshape(-1)).max() < 1e-12


@pytest.mark.serial
@pytest.mark.parametrize("stiffness", [1e-6, 1.0])
def test_no_iterate_proves_that_a_body_on_springs_cannot_give_way(
    stiffness: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The lower body may go down with the upper one, by any factor."""
    measure, factors = Iterate.equilibrium_residual, []
    pressed = from_mapping(
        {
            "mesh": {"builder": "stack", "h": 0.25},
            "material": {"locking_limit": 1e-3},
            "loads": {
                "displacements": [{"on": "top", "value": [0.0, -0.3]}],
                "springs": [{"on": "bottom", "stiffness": stiffness}],
            },
            "contact": {"on": "upper_bottom", "against": "lower_top"},
            "friction": {"coefficient": 0.0},
        }
    )
    target = SolvableStudy(assemble(pressed, MPI.COMM_SELF)).solver.target

    def noting(self: Iterate, scale: float, tolerance: float) -> float:
        factors.append(judge.excluded_factor(self, target))
        return measure(self, scale, tolerance)

    monkeypatch.setattr(Iterate, "equilibrium_residual", noting)
    solved(pressed, MPI.COMM_SELF)
    assert factors and set(factors) == {None}
