"""The steps of a process, one solution after the other.

1. Put the problem to the next time: loads, prescribed displacements, gaps.
2. Solve the problem of the step, from the state before if that helps.
   Where the solve fails, and a proof says that nothing is admissible a little later, the limit of
   the strain is the cause: no other way of solving is tried, nor a time that failed before.
3. Judge the solution: the certificate, and the energy balance of the step.  If the solve or a
   criterion fails, or if a foundation has moved to where none can be, go back to 1 with half the
   step, down to the least step.  There the process fails, or stops with the last solution.
4. Add the row to the history and hand out the solution.
5. Friction remembers the displacement and the slip.  Go on with 1.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from contact_locking.certificate.energy import EnergyBalance, Moment, energy_balance
from contact_locking.certificate.laws import ENTRY
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.errors import InputError, Misplaced, ProcessEnded, with_key
from contact_locking.monitor import Monitor
from contact_locking.process.checkpoint.stored import restored_step
from contact_locking.process.of_study import certified, followers_of, of_study, solver_of
from contact_locking.process.timeline import Timeline
from contact_locking.results.history import History, Row, values_of
from contact_locking.results.probe_table import ProbeSample
from contact_locking.results.quantities import columns, components
from contact_locking.results.solution import State, StudySolution
from contact_locking.solver.task import SolverReport
from contact_locking.study.assembly import StudyProblem

# How much later, as a share of the time, a proof is asked for where a step fails.
_BEYOND = 0.03
#: The columns of a step that add up over the steps.
SUMMED = ("work", "dissipated", "numerical")


def row_of(
    solution: StudySolution, history: History, at: float, energy: EnergyBalance, seconds: float
) -> Row:
    """The row of history.csv for the next step."""
    summary = solution.summary
    reactions = summary["certificate"]["resultants"]["reactions"]
    dim = len(reactions)
    row: dict[str, float] = {"step": len(history) + 1, "t": at} | columns(summary, dim)
    row |= components("reaction", reactions)
    for name, force in summary["reactions"].items():
        row |= components(f"reaction_{name}", force)
    several = len(summary["contacts"]) > 1
    for entry in summary["contacts"]:
        ending = f"_{entry['name']}" if several else ""
        row |= columns(entry, dim, ending) if several else {}
        for name in ("force", "travel") if "tool" in entry else ():
            row[f"tool_{name}{ending}"] = entry["tool"][name]
        if "motion" in entry:
            row |= components(f"motion{ending}", entry["motion"])
    row |= {
        "stored": energy.stored,
        "work": energy.work,
        "dissipated": energy.dissipated,
        "numerical": energy.numerical,
        "energy_defect": energy.defect,
    }
    row |= {f"{name}_total": history.last(f"{name}_total") + row[name] for name in SUMMED}
    criteria = summary["certificate"]["criteria"].values()
    row |= {
        "converged": int(solution.converged),
        "tangents": summary["iterations"]["tangents"],
        "linear": summary["iterations"]["linear"],
        "residual": summary["residual"],
        "nearest_criterion": max(entry["value"] / entry["limit"] for entry in criteria),
        "seconds": seconds,
    }
    return row


def totals(history: History, halvings: int, planned: int) -> dict[str, Any]:
    """The key ``steps`` of summary.json."""
    last = {
        name.removesuffix("_total"): history.last(name)
        for name in ("work_total", "stored", "dissipated_total", "numerical_total")
    }
    return {
        "solved": int(sum(row["converged"] for row in history)),
        "planned": planned,
        "halvings": halvings,
        "time": history.last("t"),
        "tangents": int(sum(row["tangents"] for row in history)),
        "seconds": sum(row["seconds"] for row in history),
        **last,
        "ended": None,
    }


CRITERION = "energy_balance"


class Steps(Iterator[StudySolution]):
    """The solutions of an assembled problem with steps, in the order of their times; collective.

    ``problem`` may be changed between two steps; ``history`` has the numbers of the steps so far.
    After a step that does not converge, whatever its length, the iteration ends with the state that
    was reached.  Raises InputError, with the time, for data that cannot be used at a time; after a
    first step this is ProcessEnded.  ``saved`` are the checkpoints of steps that were solved
    earlier: they are read and judged again, and the iteration goes on from the last of them.
    Whoever stops earlier calls :meth:`close`, on all ranks.
    """

    def __init__(
        self,
        problem: StudyProblem,
        monitor: Monitor | None = None,
        petsc_options: Mapping[str, Any] | None = None,
        saved: Sequence[Path] = (),
    ) -> None:
        given = problem.parameters.steps
        assert given is not None
        self.problem, self.history = problem, History()
        self._monitor = monitor or Monitor()
        self._solver = solver_of(problem, self._monitor, petsc_options)
        self._timeline = Timeline(given)
        self._planned = self._timeline.left
        self._halved: tuple[str, ...] = ()
        self._is_unbalanced, self._follows_branch, self._seconds = False, True, 0.0
        self._probes: tuple[ProbeSample, ...] = ()
        self._saved = saved
        self._solutions = self._solve()

    def __next__(self) -> StudySolution:
        return next(self._solutions)

    def close(self) -> None:
        """End the iteration and destroy the PETSc objects; collective."""
        self._solutions.close()

    def _solve(self) -> Generator[StudySolution]:
        timeline = self._timeline
        solution: StudySolution | None = None
        last: State | None = None
        before: Moment | None = None
        if self._saved and self.problem.parameters.sensitivities is not None:
            raise InputError(
                "take all steps of a process, as friction remembers each: start without --restart",
                "sensitivities",
            )
        followers = followers_of(self.problem, self._solver, self._monitor)
        try:
            for path in self._saved:
                state, step, energy = restored_step(path, self.problem, self._solver)
                self._halved, self.history = step.halved, step.history
                solution = self._solution(state, energy, step.time)
                solution = self._with_history(solution, f"the step was read from {path}")
                yield solution
                timeline.skip_to(step.time)
                last, before = solution.state, Moment.of(state)
                self.problem.enter(last.contacts)
            self._began, self._to_solve = time.perf_counter(), timeline.left
            while not timeline.is_over:
                began = time.perf_counter()
                at = timeline.target
                try:
                    if timeline.is_barred:
                        if timeline.fail():
                            continue
                        if solution is not None and self._stops:
                            told = timeline.explained(timeline.failed.get(at, ""), at, -math.inf)
                            yield self._stopped(solution, told["reason"])
                            return
                    self.problem.advance(at)
                    self._solver.begin()
                    # The proofs of balance are asked for where a solve has failed before.
                    is_unbalanced = self._is_unbalanced and self._solver.is_unbalanced()
                    if is_unbalanced and timeline.fail():
                        continue
                    report = self._solve_at(at, last)
                except InputError as error:
                    is_misplaced = isinstance(error, Misplaced)
                    if is_misplaced and self._halve(
                        f"the step to t = {at:.6g} takes {error.key} too far"
                    ):
                        continue
                    text = f"at t = {at:.6g} {error}" if is_misplaced else str(error)
                    if solution is None:
                        raise InputError(text, error.key) from error
                    if is_misplaced and self._stops:
                        yield self._stopped(solution, text)
                        return
                    entries = self._end(solution, f"{error.key}: {text}")
                    raise ProcessEnded(text, error.key, entries) from error
                reached = at == timeline.planned
                if report.is_infeasible:
                    timeline.refuse(at, report)
                if not report.converged and timeline.refused is not None:
                    timeline.failed[at] = report.reason
                self._is_unbalanced |= report.is_unbalanced
                # The branch is followed once at most on the way to a planned time.
                self._follows_branch = report.converged and (reached or self._follows_branch)
                if not report.converged and self._halve(
                    f"the step to t = {at:.6g} did not converge ({report.reason})"
                ):
                    continue
                state = self._solver.state(report)
                energy, after = energy_balance(before or Moment.at_rest(state), state)
                found = self._solution(state, energy, at)
                # Half the step misses a foundation between the nodes as well.
                entering = found.summary["certificate"]["criteria"].get(ENTRY, {"holds": True})
                if (
                    not found.converged
                    and entering["holds"]
                    and self._halve(
                        f"the step to t = {at:.6g} did not converge ({found.summary['reason']})"
                    )
                ):
                    continue
                if not found.converged:
                    # Where the process stops, its words begin with the last time.
                    last_time = solution.time if solution and not self._stops else -math.inf
                    told = timeline.explained(found.summary["reason"], at, last_time)
                    found = found.telling(**told)
                    if solution is not None and self._stops:
                        yield self._stopped(solution, found.summary["reason"])
                        return
                solution, before = found, after
                for follower in followers:
                    solution = follower.after(solution, report, at)
                seconds = self._seconds = time.perf_counter() - began
                self.history.rows.append(row_of(solution, self.history, at, energy, seconds))
                self._require_columns()
                solution = self._with_history(solution)
                yield solution
                if not solution.converged:
                    return
                timeline.succeed()
                last = solution.state
                self.problem.enter(last.contacts)
        finally:
            for follower in followers:
                follower.close()
            self._solver.close()
            self.problem.close()

    def _require_columns(self) -> None:
        """Raise InputError, after the first step, for charts of columns that there are not."""
        for number, chart in enumerate(self.problem.parameters.output.charts):
            for key, text in (("x", chart.x), ("y", chart.y)):
                key = f"output.charts.{number}.{key}"
                with_key(key, partial(values_of, text, self.history))

    def _solve_at(self, at: float, last: State | None) -> SolverReport:
        """Solve at the present time; collective."""
        left = self._timeline.left
        planned, taken = self._to_solve - left, time.perf_counter() - self._began
        # Nothing tells how long it takes to find out how far the process can go.
        is_known = planned and not self._timeline.is_halved
        seconds = left * max(taken / planned, self._seconds) if is_known else None
        self._monitor.step(len(self.history) + 1, left, at, seconds)
        saved = None if last is None else last.saved
        is_near = self._timeline.refused is not None
        asks = not is_near and at == self._timeline.planned and self._solver.may_lock_up
        searches = not (is_near or asks)
        report = self._solver.solve(saved, self._follows_branch, searches)
        if report.converged or report.is_infeasible or not asks or self._locks_up_after(at):
            return report
        self.problem.advance(at)
        self._solver.begin()
        return self._solver.solve(saved, self._follows_branch)

    def _locks_up_after(self, at: float) -> bool:
        """Whether a proof shows that nothing is admissible a little later; collective."""
        beyond = at + _BEYOND * (at - self.problem.clock.start)
        try:
            self.problem.advance(beyond)
            self._solver.begin()
            verdict = self._solver.verdict()
        except InputError:
            return False
        finally:
            self.problem.advance(at)
            self._solver.begin()
        if verdict is None:
            return False
        told = SolverReport(is_infeasible=True, reason=verdict.reason, suggestion=verdict.way_out)
        self._timeline.refuse(beyond, told)
        return True

    @property
    def _stops(self) -> bool:
        given = self.problem.parameters.steps
        return given is not None and given.on_failure == "stop"

    def _stopped(self, last: StudySolution, reason: str) -> StudySolution:
        """The last solution, which is that of a process that goes no farther."""
        ended = f"the process ends at t = {last.time:.6g} ({reason})"
        steps = {**last.summary["steps"], "halvings": len(self._halved), "ended": ended}
        told = [ended, *last.summary["warnings"], *self._halved[len(last.halved) :]]
        return last.telling(steps=steps, warnings=told)

    def _halve(self, failure: str) -> bool:
        """Halve the step after a failure, if it may be halved, and say so."""
        if not self._timeline.fail():
            return False
        # The line about the failed solve comes before the line that says why.
        self._monitor.finish()
        text = f"{failure}; it is halved"
        self._halved = (*self._halved, text)
        self._monitor.message(f"warning: {text}")
        return True

    def _solution(self, state: SolvedState, energy: EnergyBalance, at: float) -> StudySolution:
        """The solution of a step with its certificate; collective."""
        derivatives = self._solver.derivatives(state.report)
        certificate = certified(self.problem.parameters, state)
        criteria = {**certificate.criteria, CRITERION: energy.criterion(state)}
        judged = dataclasses.replace(certificate, criteria=criteria)
        found = of_study(self.problem, state, judged, derivatives)
        return dataclasses.replace(found, time=at)

    def _end(self, last: StudySolution, reason: str) -> dict[str, Any]:
        """The entries by which the last solution says why the process fails with it."""
        new = self._halved[len(last.halved) :]
        return {
            "converged": False,
            "reason": reason,
            "suggestion": "",
            "steps": {**last.summary["steps"], "halvings": len(self._halved)},
            "warnings": [*last.summary["warnings"], *new],
        }

    def _with_history(self, solution: StudySolution, restart: str | None = None) -> StudySolution:
        """A solution with the history of the process."""
        self._probes += tuple(
            dataclasses.replace(taken, step=len(self.history), time=solution.time)
            for taken in solution.probes
        )
        told = [*solution.summary["warnings"], *self._halved, *self._solver.unused_options()]
        steps = totals(self.history, len(self._halved), self._planned)
        return dataclasses.replace(
            solution.telling(restart=restart, steps=steps, warnings=told),
            probes=self._probes,
            history=History([*self.history.rows]),
            halved=self._halved,
        )
