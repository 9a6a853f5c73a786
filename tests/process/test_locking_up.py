"""A process that locks up says so, and ends where it can no longer go on."""

from __future__ import annotations

from typing import Any

import pytest
from seal import seal

from contact_locking import solve_steps
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.results.in_words import verdict
from contact_locking.results.solution import StudySolution
from contact_locking.running.process import run_steps
from contact_locking.solver.task import SolverReport


def searching(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether each solve may search for a solution in other ways."""
    found, solve_one = list[bool](), ProblemSolver.solve

    def solved(solver: ProblemSolver, *given: Any) -> SolverReport:
        found.append(given[2] if len(given) > 2 else True)
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


# It reads the files of the run, which rank 0 writes.
@pytest.mark.serial
def test_a_run_that_stops_has_the_last_solution_in_its_files(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    solve_one = ProblemSolver.solve

    def solved(solver: ProblemSolver, *given: Any) -> SolverReport:
        if solver.problem.clock.now > 0.6:  # type: ignore[attr-defined]
            return SolverReport(reason="it is late", suggestion="be quick")
        return solve_one(solver, *given)

    monkeypatch.setattr(ProblemSolver, "solve", solved)
    steps = {"to": 1, "count": 2, "least": 0.2, "on_failure": "stop"}
    output = {"picture": False, "fields": False}
    last, _ = run_steps(seal(steps=steps, output=output), tmp_path)
    assert isinstance(last, StudySolution) and last.converged and last.time == 0.5
    assert len(last.history) == 1 and "it is late" in last.summary["steps"]["ended"]
    assert (tmp_path / "history.csv").read_text().count("\n") == 2
