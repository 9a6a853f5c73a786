"""Solutions beside the one that was found: proved to be none, proved to be there, or not known."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
import ufl
from mpi4py import MPI
from problems import solved
from sweep.case import Study

from contact_locking.results.solution import StudySolution
from contact_locking.running.assembly import assemble
from contact_locking.running.solving import solve, solve_assembled, solve_steps
from contact_locking.study_file.parameters import Parameters
from contact_locking.theory.other_solutions import IF_CONVEX, OTHERS, OWN_ENERGY, UNIQUE

pytestmark = pytest.mark.serial

_LEFT = {"on": "left", "value": [0.0, None]}
_DOWN = {"on": "top", "value": [0.0, -0.01]}


def study(loads: Study, contact: Any, **more: Any) -> Parameters:
    """A square of 4 by 4 cells without friction."""
    data = {
        "mesh": {"builder": "block", "h": 0.25, "structured": True},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
        "loads": loads,
        "contact": contact,
    }
    return Parameters.model_validate(data | more)


def between(gap: float = 0.01) -> list[Study]:
    return [{"on": "bottom", "gap": gap}, {"on": "top", "gap": gap}]


def said(solution: StudySolution) -> tuple[str, str]:
    entry = solution.summary["certificate"]["constants"]["uniqueness"]
    return entry["verdict"], entry["why"]


@pytest.mark.parametrize("n", [math.inf, 1e3])
def test_a_block_with_play_between_two_foundations_has_other_solutions(n: float) -> None:
    verdict, why = said(solved(study({"displacements": [_LEFT]}, between(), penalty={"n": n})))
    assert verdict == OTHERS
    assert why.endswith("translation along y")


@pytest.mark.parametrize("n", [math.inf, 1e3])
@pytest.mark.parametrize("gap", [0.01, -0.002])
def test_a_block_that_pressure_holds_has_no_other_solution(gap: float, n: float) -> None:
    """It is pressed onto one of two foundations, or pinched by both."""
    loads = {"displacements": [_LEFT], "tractions": [_DOWN] * (gap > 0.0)}
    verdict, why = said(solved(study(loads, between(gap), penalty={"n": n})))
    assert verdict == UNIQUE
    assert ("need not be" in why) == math.isinf(n)


def test_a_tool_that_no_force_pushes_may_travel() -> None:
    space = {"point": [0, 1.5], "normal": [0, -1]}
    tool = {"half_space": space, "force": [0, "-0.05*max(t - 0.6, 0)"]}
    given = study(
        {"displacements": [{"on": "bottom", "value": [0, 0]}]},
        {"on": "top", "foundation": tool},
        steps={"times": [0.5, 1.0]},
    )
    *_, first, second = (said(solution) for solution in solve_steps(given))
    assert first[0] == OTHERS
    assert first[1].endswith("the tool on top along (0, -1)")
    assert second[0] == UNIQUE


@pytest.mark.parametrize(("gap", "verdict"), [(0.01, OWN_ENERGY), (-0.002, IF_CONVEX)])
def test_with_an_energy_of_the_users_own_its_convexity_is_assumed(gap: float, verdict: str) -> None:
    given = study({"displacements": [_LEFT]}, between(gap), penalty={"n": 1e3})
    problem = assemble(given, MPI.COMM_WORLD)
    data = problem.data

    def stiffens(u: Any) -> Any:
        return ufl.inner(data.strain(u), data.strain(u)) ** 2 * data.dx

    problem.data = replace(data, own_energy=stiffens)
    assert said(solve_assembled(problem))[0] == verdict


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_solve_that_fails_has_no_verdict() -> None:
    loads = {"displacements": [_LEFT, {"on": "right", "value": [0.1, None]}]}
    material = {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.01}
    found = solve(study(loads, between(), material=material))
    assert not found.converged
    assert said(found)[0].startswith("not known")
