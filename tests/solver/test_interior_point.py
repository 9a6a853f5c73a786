"""The interior point method: any n, agreement with theory, what is infeasible."""

from __future__ import annotations

import math

import pytest
from problems import block, solved
from solved_by_cg import crushed_steel

from contact_locking.running import solving
from contact_locking.study_file.parameters import Parameters


def _stretched(by: float, n: float) -> Parameters:
    ends = [{"on": "left", "value": [0.0, 0.0]}, {"on": "right", "value": [by, None]}]
    return block(penalty__n=n, loads={"displacements": ends})


@pytest.mark.serial
@pytest.mark.parametrize("by", [0.0205, 0.2])
def test_displacements_that_no_field_within_the_limit_follows_are_infeasible(by: float) -> None:
    # The mean strain along x is by, and |eps| is no less: 0.02/by of it can be followed.
    summary = solving.solve(_stretched(by, math.inf)).summary
    assert not summary["converged"]
    assert summary["failure"] == "solver.infeasible"
    low, high = summary["admissible_load_factor"]
    assert low <= 0.02 / by <= high * (1.0 + 1e-3)
    assert high <= 1.02 * low


def test_an_iterative_solver_proves_a_block_of_steel_in_millimetres_infeasible() -> None:
    # The proof balances the multipliers with springs that are 1e6 times as stiff as the steel.
    summary = solving.solve(crushed_steel()).summary
    assert summary["failure"] == "solver.infeasible"
    # The mean strain along z is 0.02, and |eps| is no less.
    assert 0.5 <= summary["admissible_load_factor"][1] <= 0.5 * (1.0 + 1e-3)


@pytest.mark.serial
def test_foundation_that_no_strain_within_the_limit_makes_room_for_is_infeasible() -> None:
    # It stands 0.1 inside the body, up to the clamped side: no displacement to scale.
    summary = solving.solve(block(contact__gap=-0.1, penalty__n=math.inf)).summary
    assert summary["failure"] == "solver.infeasible"
    assert summary["admissible_load_factor"] is None


@pytest.mark.serial
def test_penalty_lets_the_strain_exceed_a_limit_that_cannot_be_kept() -> None:
    solution = solving.solve(_stretched(0.0205, 1e3))
    assert solution.converged
    assert solution.summary["strain_norm_max"] > 0.0205
    soft = solving.solve(_stretched(0.03, 1e1))
    assert any(warning.code == "limit.exceeded" for warning in soft.warnings)


def test_an_iterative_solver_solves_at_n_infinite_on_any_number_of_ranks() -> None:
    changes = {"penalty__n": math.inf, "solver__linear": "iterative", "mesh__structured": True}
    parameters = block(3, 1 / 8, **changes)
    assert solving.solve(parameters).converged


def test_an_iterative_solver_that_gets_nowhere_is_said_to() -> None:
    parameters = block(3, 0.15, solver__linear="iterative")
    solution = solving.solve(parameters, petsc_options={"ksp_max_it": 1})
    assert not solution.converged
    assert solution.failure == "solver.linear"


@pytest.mark.parametrize("length", [1.0, 1e9])
def test_friction_with_any_regularisation_takes_few_tangents(length: float) -> None:
    found = solved(block(2, 0.2, material__locking_limit=0.02, friction__regularisation=length))
    assert found.converged and found.summary["iterations"]["tangents"] <= 16
