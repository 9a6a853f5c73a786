"""The steps of a process, one solution after the other.

1. Put the problem to the next time: loads, prescribed displacements, gaps.
2. Solve the problem of the step, from the state before if that helps.  If the solve fails, go back
   to 1 with half the step, down to the least step.
3. Judge the solution: the certificate, and the energy balance of the step.
4. Add the row to the history and hand out the solution.
5. Friction remembers the displacement and the slip.  Go on with 1.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Generator, Iterator, Mapping
from typing import Any

from contact_locking.certificate import certify
from contact_locking.certificate.energy import Moment, energy_balance
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.monitor import Monitor
from contact_locking.problem.assembly import Problem
from contact_locking.results.history import History
from contact_locking.results.solution import Solution
from contact_locking.solver import SavedState, SolverReport
from contact_locking.steps.account import row_of, totals
from contact_locking.steps.increment import Increment, solution_of
from contact_locking.steps.timeline import Timeline

CRITERION = "energy_balance"


class Steps(Iterator[Solution]):
    """The solutions of an assembled problem with steps, in the order of their times; collective.

    ``problem`` may be changed between two steps; ``history`` has the numbers of the steps so far.
    After a step that does not converge, whatever its length, the iteration ends with the state that
    was reached.  Whoever stops earlier calls :meth:`close`, on all ranks.
    """

    def __init__(
        self,
        problem: Problem,
        monitor: Monitor | None = None,
        petsc_options: Mapping[str, Any] | None = None,
    ) -> None:
        given = problem.parameters.steps
        assert given is not None
        self.problem, self.history = problem, History()
        self._monitor = monitor or Monitor()
        self._increment = Increment(problem, self._monitor, petsc_options)
        self._timeline = Timeline(given)
        self._planned = self._timeline.left
        self._halved: list[str] = []
        self._solutions = self._solve()

    def __next__(self) -> Solution:
        return next(self._solutions)

    def close(self) -> None:
        """End the iteration and destroy the PETSc objects; collective."""
        self._solutions.close()

    def _solve(self) -> Generator[Solution]:
        timeline, problem = self._timeline, self.problem
        saved: SavedState | None = None
        before: Moment | None = None
        try:
            while not timeline.is_over:
                began = time.perf_counter()
                at = timeline.target
                report = self._solve_at(at, saved)
                if not report.converged and self._halve(at, report.reason):
                    continue
                state = self._increment.state(report)
                solution, before = self._judged(state, before or Moment.at_rest(state), at, began)
                solution.summary["warnings"] += self._increment.unused_options()
                yield solution
                if not solution.converged:
                    return
                timeline.succeed()
                saved = _saved(state)
                for contact in problem.contacts:
                    contact.remember(problem.u)
        finally:
            problem.close()

    def _solve_at(self, at: float, saved: SavedState | None) -> SolverReport:
        """Solve at a time; collective."""
        self._monitor.step(len(self.history) + 1, self._timeline.left, at, self._seconds_left())
        self._increment.advance(at)
        return self._increment.solve(saved)

    def _halve(self, at: float, reason: str) -> bool:
        """Halve the step after a failure, if it may be halved, and say so."""
        timeline = self._timeline
        if not timeline.fail():
            return False
        text = f"the step to t = {at:.6g} did not converge ({reason}); it is halved"
        self._halved.append(text)
        self._monitor.message(f"warning: {text}")
        return True

    def _judged(
        self, state: SolvedState, before: Moment, at: float, began: float
    ) -> tuple[Solution, Moment]:
        """The solution with its certificate, and the moment of the state; collective."""
        energy, moment = energy_balance(before, state)
        certificate = certify(state)
        criteria = {**certificate.criteria, CRITERION: energy.criterion(state)}
        solution = solution_of(state, dataclasses.replace(certificate, criteria=criteria))
        # The next step overwrites the displacement of the problem.
        own = self.problem.u.copy()
        own.name = self.problem.u.name
        solution = dataclasses.replace(solution, displacement=own)
        seconds = time.perf_counter() - began
        self.history.rows.append(row_of(solution, self.history, at, energy, seconds))
        solution.summary["steps"] = totals(self.history, self._timeline.halvings, self._planned)
        solution.summary["warnings"] += self._halved
        return solution, moment

    def _seconds_left(self) -> float | None:
        """About how long the planned steps that are left will take; None before the first step."""
        if not self.history.rows:
            return None
        seconds = self.history.column("seconds")
        return float(seconds.mean()) * self._timeline.left


def _saved(state: SolvedState) -> SavedState:
    """The solved state for the solver to start the next step from."""
    pressures = tuple(fields.pressure for fields in state.contacts)
    return SavedState(state.problem.u.x.array.copy(), pressures, state.target.penalty)
