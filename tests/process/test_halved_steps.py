"""Steps that fail are halved, down to the least, and a process goes as far as it can."""

from __future__ import annotations

import math
from typing import Any

import pytest
from problems import block
from sheared_block import all_of, sheared

from contact_locking import solve_steps
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.solver.task import SolverReport
from contact_locking.study.assembly import StudyProblem

pytestmark = pytest.mark.serial


def now_of(solver: ProblemSolver) -> float:
    assert isinstance(solver.problem, StudyProblem)
    return solver.problem.clock.now


class Failing:
    """Lets every solve over a longer time than ``most`` fail."""

    def __init__(self, most: float) -> None:
        self.most, self.done, self.times = most, 0.0, [0.0]

    def patch(self, monkeypatch: pytest.MonkeyPatch) -> None:
        solve_one = ProblemSolver.solve

        def solved(solver: ProblemSolver, *given: Any) -> SolverReport:
            now = now_of(solver)
            if now - self.done > self.most:
                return SolverReport(reason="too far", suggestion="be quick")
            self.done = now
            self.times.append(now)
            return solve_one(solver, *given)

        monkeypatch.setattr(ProblemSolver, "solve", solved)


def test_a_step_that_does_not_converge_is_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    failing = Failing(0.3)
    failing.patch(monkeypatch)
    found = all_of(sheared(2))
    assert failing.times == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])
    halved = [text for text in found[-1].summary["warnings"] if "it is halved" in text]
    assert len(halved) == found[-1].summary["steps"]["halvings"] >= 2
    assert found[-1].summary["steps"]["solved"] == 4


def test_a_step_whose_solution_fails_a_criterion_is_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    """A state that the solver takes for a solution is not, if it is far from the last one."""
    solve_one, last = ProblemSolver.solve, [0.0]

    def wrong(solver: ProblemSolver, *given: Any) -> SolverReport:
        report, now = solve_one(solver, *given), now_of(solver)
        if now - last[0] > 0.3:
            solver.problem.u.x.array[:] *= 1.001
        else:
            last[0] = now
        return report

    monkeypatch.setattr(ProblemSolver, "solve", wrong)
    found = all_of(sheared(2))
    assert [one.time for one in found] == pytest.approx([0.25, 0.5, 0.75, 1.0])
    halved = [text for text in found[-1].summary["warnings"] if "it is halved" in text]
    assert len(halved) == 2
    assert "above 1e-0" in halved[0]


def test_halving_ends_at_the_least_step(monkeypatch: pytest.MonkeyPatch) -> None:
    failing = Failing(0.01)
    failing.patch(monkeypatch)
    steps = {"to": 1.0, "count": 2, "least": 0.1}
    found = list(solve_steps(sheared(2, steps=steps, penalty__n=1e3)))
    assert len(found) == 1 and not found[0].converged
    assert found[0].summary["reason"] == "too far"
    assert found[0].summary["steps"]["halvings"] == 2


def test_a_process_goes_as_far_as_the_locking_limit_lets_it() -> None:
    # Between two clamped ends the strain is at least the relative elongation: 0.02 at t = 0.4.
    loads = {
        "displacements": [
            {"on": "left", "value": [0, None]},
            {"on": "right", "value": ["0.05*t", None]},
            {"on": ["bottom", "top"], "value": [None, 0]},
        ]
    }
    steps = {"to": 1.0, "count": 2, "least": 0.02}
    found = list(
        solve_steps(
            block(
                h=0.5,
                loads=loads,
                contact={"on": []},
                friction={},
                steps=steps,
                penalty__n=math.inf,
            )
        )
    )
    assert not found[-1].converged and found[-1].summary["reason"].startswith("infeasible")
    last = [solution.time for solution in found if solution.converged][-1]
    assert 0.4 - 0.04 <= last <= 0.4
