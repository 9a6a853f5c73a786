"""A process that runs into its limit does not try times that proofs for other times exclude."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from rings import floor, ring
from slow import slow

from contact_locking import Parameters, solve, solve_steps
from contact_locking.process.of_study import solver_of
from contact_locking.process.out_of_reach import AdmissibilityData, OutOfReach
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.results.solution import StudySolution
from contact_locking.solver.task import SolverReport
from contact_locking.study.assembly import StudyProblem, assemble

STEPS = {"times": [0.3, 1.0], "least": 0.04}


def pushed(foundation: dict[str, Any] | None = None, **changes: Any) -> Parameters:
    """A ring that is pushed towards a foundation, farther than its limit lets it."""
    return ring([0.02, "-0.1*t"], foundation or floor(), **({"steps": STEPS} | changes))


def data_at(parameters: Parameters, times: list[float]) -> list[AdmissibilityData]:
    problem = assemble(parameters, MPI.COMM_WORLD)
    solver = solver_of(problem)
    found = []
    for time in times:
        problem.advance(time)
        solver.begin()
        found.append(AdmissibilityData.of(solver.system, time))
    return found


def now_of(solver: ProblemSolver) -> float:
    assert isinstance(solver.problem, StudyProblem)
    return solver.problem.clock.now


def times_and_reports(
    parameters: Parameters, monkeypatch: pytest.MonkeyPatch
) -> tuple[list[float], list[SolverReport], StudySolution]:
    times, reports, solve_one = [], [], ProblemSolver.solve

    def solved(solver: ProblemSolver, *given: Any) -> SolverReport:
        report = solve_one(solver, *given)
        times.append(now_of(solver))
        reports.append(report)
        return report

    monkeypatch.setattr(ProblemSolver, "solve", solved)
    *_, last = solve_steps(parameters)
    return times, reports, last


@pytest.mark.parametrize(
    "parameters",
    [pushed(), slow(ring([0.02, 0.0], floor(motion=[0.0, "0.1*t"]), steps=STEPS))],
    ids=["body", "tool"],
)
def test_no_time_beyond_one_that_is_out_of_reach_is_tried(
    parameters: Parameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    times, reports, last = times_and_reports(parameters, monkeypatch)
    assert not last.converged and "infeasible" in last.summary["reason"]
    refused = [t for t, report in zip(times, reports, strict=True) if report.is_infeasible]
    assert refused[0] == 1.0 and len(refused) > 1
    assert refused == sorted(set(refused), reverse=True)
    for number, time in enumerate(times[1:], start=1):
        assert time == 1.0 or all(time < t for t in times[:number] if t in refused)
    # The last row is the state where the process ended; charts leave it out.
    (*solved, failed), steps = last.history.column("converged"), last.summary["steps"]
    assert all(solved) and not failed and steps["solved"] == len(solved)


def test_what_is_impossible_is_not_tried_in_other_ways() -> None:
    """The proof that nothing is admissible comes after the first approach to the solution."""
    mesh = {"builder": "annulus", "h": 0.2}
    found = solve(ring([0.02, -0.07], floor(), mesh=mesh, friction={"coefficient": 0.4}))
    assert found.summary["reason"].startswith("infeasible")
    assert found.summary["iterations"]["friction"] <= 100
    low, high = found.summary["admissible_load_factor"]
    assert 0.5 < low < high < 1.0


@pytest.mark.parametrize(
    ("parameters", "is_straight"),
    [
        (pushed(), True),
        (ring([0.02, "-0.1*t**2"], floor(), steps=STEPS), False),
        (pushed(floor(motion=[0.0, "0.1*t"])), True),
        (pushed(floor(motion=[0.0, "0.1*sin(t)"])), False),
        (pushed(floor(motion={"rotation": "0.1*t", "about": [0, 0]})), False),
    ],
)
def test_only_a_straight_way_leads_from_one_proof_to_another(
    parameters: Parameters, is_straight: bool
) -> None:
    reached, refused, beyond = data_at(parameters, [0.1, 0.5, 0.8])
    assert beyond.is_beyond(refused, reached) == is_straight
    assert not reached.is_beyond(refused, reached)
    assert not refused.is_beyond(beyond, reached)
    out_of_reach = OutOfReach()
    out_of_reach.add(refused, SolverReport(is_infeasible=True))
    assert out_of_reach.excludes(refused) and not out_of_reach.excludes(beyond)
    out_of_reach.reach(reached)
    assert out_of_reach.excludes(beyond) == is_straight
    out_of_reach.add(beyond, SolverReport(reason="too few iterations"))
    assert not out_of_reach.excludes(reached)


def test_what_was_asked_before_is_as_impossible_again() -> None:
    there, elsewhere, back = data_at(
        ring([0.02, "-0.1*sin(t)"], floor(), steps={"times": [9.0]}), [0.4, 1.0, math.pi - 0.4]
    )
    assert back.repeats(there) and not elsewhere.repeats(there)
    # Whoever uses Steps may change the problem between two of them.
    normals, limits, origin = back.fixed
    other = dataclasses.replace(back, fixed=(normals, 2.0 * limits, origin))
    assert not other.repeats(there)
    more = dataclasses.replace(back, fixed=(normals, np.tile(limits, 2), origin))
    assert not more.repeats(there) and not more.is_beyond(there, there)


@pytest.mark.slow
def test_penalised_contact_says_nothing_of_later_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its solution may be behind the foundation, and then is not admissible itself."""
    reached: list[float] = []
    monkeypatch.setattr(OutOfReach, "reach", lambda _, data: reached.append(data.time))
    steps = {"times": [0.1, 0.2]}
    list(solve_steps(pushed(steps=steps, penalty={"epsilon": 0.1})))
    assert reached == []
    list(solve_steps(pushed(steps=steps)))
    assert reached == [0.1, 0.2]
