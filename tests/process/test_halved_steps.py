"""Steps that fail are halved down to the least, and a process that locks up ends and says so."""

from __future__ import annotations

from typing import Any

import pytest
from problems import all_of, floor, ring, seal, sheared
from slow import slow

from contact_locking import Parameters, solve_steps
from contact_locking.process.loop import Timeline
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.results.in_words import verdict
from contact_locking.results.solution import StudySolution
from contact_locking.running.assembly import StudyProblem
from contact_locking.running.run import run
from contact_locking.solver.settings import Steps
from contact_locking.solver.task import Outcome

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

        def solved(solver: ProblemSolver, *given: Any) -> Outcome:
            now = now_of(solver)
            if now - self.done > self.most:
                return Outcome(reason="too far", suggestion="be quick")
            self.done = now
            self.times.append(now)
            return solve_one(solver, *given)

        monkeypatch.setattr(ProblemSolver, "solve", solved)


def test_a_step_that_does_not_converge_is_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    failing = Failing(0.3)
    failing.patch(monkeypatch)
    found = all_of(sheared(2))
    assert failing.times == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])
    halved = [x for x in found[-1].warnings if x.code == "steps.halved"]
    assert len(halved) == found[-1].summary["steps"]["halvings"] >= 2
    assert found[-1].summary["steps"]["solved"] == 4


def test_a_step_whose_solution_fails_a_criterion_is_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    """A state that the solver takes for a solution is not, if it is far from the last one."""
    solve_one, last = ProblemSolver.solve, [0.0]

    def wrong(solver: ProblemSolver, *given: Any) -> Outcome:
        report, now = solve_one(solver, *given), now_of(solver)
        if now - last[0] > 0.3:
            solver.problem.u.x.array[:] *= 1.001
        else:
            last[0] = now
        return report

    monkeypatch.setattr(ProblemSolver, "solve", wrong)
    found = all_of(sheared(2))
    assert [one.time for one in found] == pytest.approx([0.25, 0.5, 0.75, 1.0])
    halved = [x for x in found[-1].warnings if x.code == "steps.halved"]
    assert [finding.numbers["time"] for finding in halved] == [0.5, 1.0]


def test_halving_ends_at_the_least_step(monkeypatch: pytest.MonkeyPatch) -> None:
    failing = Failing(0.01)
    failing.patch(monkeypatch)
    steps = {"to": 1.0, "count": 2, "least": 0.1}
    found = list(solve_steps(sheared(2, steps=steps, penalty__n=1e3)))
    assert len(found) == 1 and not found[0].converged
    assert found[0].summary["reason"] == "too far"
    assert found[0].summary["steps"]["halvings"] == 2


STEPS = {"times": [0.3, 1.0], "least": 0.04}


def searching(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether each solve may search for a solution in other ways."""
    found, solve_one = list[bool](), ProblemSolver.solve

    def solved(solver: ProblemSolver, *given: Any) -> Outcome:
        found.append(given[1] if len(given) > 1 else True)
        return solve_one(solver, *given)

    monkeypatch.setattr(ProblemSolver, "solve", solved)
    return found


@pytest.mark.parametrize(("most", "refused"), [(1.6, "t = 1.03"), (2.4, "t = ")])
def test_a_strip_at_its_limit_is_told_with_the_limit_as_the_cause(
    most: float, refused: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 1.6 the limit of 0.2 only just admits the gap; where no proof is, one of 3 % more is."""
    tried = searching(monkeypatch)
    steps = {"to": 1, "count": 2, "least": 0.2, "on_failure": "stop"}
    *_, before, last = solve_steps(seal(f"-{most}*t", steps=steps))
    assert last.converged and last.time == before.time and 0.8 <= last.time * most <= 1.6
    assert last.summary["contacts"] == before.summary["contacts"]
    ended = last.summary["steps"]["ended"]
    assert "infeasible" in ended and "locking limit" in ended and refused in ended
    assert ended in last.summary["warnings"] and ended in verdict(last.summary)
    assert not any(tried[2:]) and len(tried) <= 6


@pytest.mark.parametrize(
    "parameters",
    [
        ring([0.02, "-0.1*t"], floor(), steps=STEPS),
        slow(ring([0.02, 0.0], floor(motion=[0.0, "0.1*t"]), steps=STEPS)),
    ],
    ids=["body", "tool"],
)
def test_no_time_beyond_one_at_which_nothing_is_admissible_is_tried(
    parameters: Parameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    times, reports, solve_one = list[float](), list[Outcome](), ProblemSolver.solve

    def solved(solver: ProblemSolver, *given: Any) -> Outcome:
        assert isinstance(solver.problem, StudyProblem)
        times.append(solver.problem.clock.now)
        reports.append(solve_one(solver, *given))
        return reports[-1]

    monkeypatch.setattr(ProblemSolver, "solve", solved)
    *_, last = solve_steps(parameters)
    assert last.failure == "solver.infeasible"
    refused = [
        t for t, report in zip(times, reports, strict=True) if report.failure == last.failure
    ]
    assert refused[0] == 1.0 and len(refused) > 1
    assert refused == sorted(set(refused), reverse=True)
    for number, time in enumerate(times[1:], start=1):
        assert time == 1.0 or all(time < t for t in times[:number] if t in refused)
    # The last row is the state where the process ended; charts leave it out.
    (*converged, failed), steps = last.history.column("converged"), last.summary["steps"]
    assert all(converged) and not failed and steps["solved"] == len(converged)


def test_a_run_that_stops_has_the_last_solution_in_its_files(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    solve_one = ProblemSolver.solve

    def solved(solver: ProblemSolver, *given: Any) -> Outcome:
        if solver.problem.clock.now > 0.6:
            return Outcome(reason="it is late", suggestion="be quick")
        return solve_one(solver, *given)

    monkeypatch.setattr(ProblemSolver, "solve", solved)
    steps = {"to": 1, "count": 2, "least": 0.2, "on_failure": "stop"}
    output = {"picture": False, "fields": False}
    last, _ = run(seal(steps=steps, output=output), tmp_path)
    assert isinstance(last, StudySolution) and last.converged and last.time == 0.5
    assert len(last.history) == 1 and "it is late" in last.summary["steps"]["ended"]
    assert (tmp_path / "history.csv").read_text().count("\n") == 2


def test_a_refused_time_bars_later_ones_up_to_the_next_planned_time() -> None:
    timeline = Timeline(Steps(times=(1.0, 2.0)))
    timeline.refuse(1.1, Outcome(reason="too far"))
    timeline.refuse(1.0, Outcome(failure="solver.infeasible"))
    seen = [(timeline.target, timeline.is_barred)]
    assert timeline.fail()
    seen.append((timeline.target, timeline.is_barred))
    assert timeline.explained("late", 0.5, 0.25)["failure"] == "solver.infeasible"
    timeline.succeed()
    seen.append((timeline.target, timeline.is_barred))
    assert seen == [(1.0, True), (0.5, False), (1.0, True)]
    # The step to the time that is refused is halved three times at most.
    assert [timeline.fail() for _ in range(3)] == [True, True, False]
    timeline.skip_to(1.0)
    timeline.succeed()
    assert timeline.refused is None and timeline.explained("late", 2.0, 1.0) == {}
