"""The steps of a process, one solution after the other.

1. Update the problem to the next time: loads, prescribed displacements, gaps.
2. Solve it, from the previous state if that helps.  If this fails and a proof says that nothing is
   admissible a little later, the strain limit is the cause: neither another way of solving nor a
   time that failed before is tried.
3. Judge the solution by the certificate and the energy balance of the step.  If the solve or a
   criterion fails, or a foundation has moved behind Gamma_C, return to 1 with half the step, down
   to the least step.  There the process fails, or stops with the last solution.
4. Add a row to the history and yield the solution.
5. Friction remembers the displacement and the slip.  Return to 1.
"""

from __future__ import annotations

import dataclasses
import math
import time as clocks
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeVar

from dolfinx import fem

from contact_locking.certificate.balances import EnergyBalance, Moment, energy_balance
from contact_locking.certificate.laws import ENTRY
from contact_locking.certificate.solved_state import Criterion, SolvedState
from contact_locking.errors import Infeasible, InputError, Misplaced, ProcessEnded
from contact_locking.findings import Finding
from contact_locking.process import checkpoint
from contact_locking.process.checkpoint import SavedSteps
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.results.probes import in_step
from contact_locking.results.quantities import columns, components
from contact_locking.results.solution import Solution, State
from contact_locking.results.table import Row, Table
from contact_locking.solver.settings import Steps
from contact_locking.solver.task import Outcome

# A proof is looked for this much later than a failed step, as a share of its time.
_BEYOND = 0.03
#: The columns of a step that add up over the steps.
SUMMED = ("work", "dissipated", "numerical")


def row_of(
    solution: Solution, history: Table, at: float, energy: EnergyBalance, seconds: float
) -> Row:
    """The row of history.csv for the next step."""
    certificate, report, dim = solution.certificate, solution.report, solution.domain.dim
    assert report is not None
    contacts = solution.facts["contacts"]
    row: dict[str, float] = {"step": len(history) + 1, "t": at} | columns(solution.facts, dim)
    row |= components("reaction", certificate.resultants["reactions"])
    for name, force in certificate.reactions.items():
        row |= components(f"reaction_{name}", force)
    several = len(contacts) > 1
    for entry in contacts:
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
        "energy_defect": math.nan if energy.defect is None else energy.defect,
    }
    row |= {f"{name}_total": history.last(f"{name}_total") + row[name] for name in SUMMED}
    row |= {
        "converged": int(solution.converged),
        "tangents": report.tangents,
        "linear": report.linear,
        "residual": certificate.residual,
        "nearest_criterion": max(
            criterion.value / criterion.limit for criterion in certificate.criteria.values()
        ),
        "seconds": seconds,
    }
    return row


def totals(history: Table, halvings: int, planned: int) -> dict[str, Any]:
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


S = TypeVar("S", bound=Solution)
S_co = TypeVar("S_co", bound=Solution, covariant=True)


class Solvable(Protocol[S_co]):
    """The interface of a problem for drivers such as :class:`Process`; collective."""

    @property
    def solver(self) -> ProblemSolver: ...

    def refresh(self) -> None:
        """Update ``solver`` to the present data.  Raises InputError for unusable data."""

    def solution(self, state: SolvedState, criteria: Mapping[str, Criterion]) -> S_co:
        """The solution in a state of ``solver``, which must meet these criteria as well."""


class Process(Iterator[S]):
    """``u_k`` at times ``t_1 < t_2 < ...``, where friction acts against ``u_tau - u_{k-1,tau}``.

    The process iterates over the solutions of a problem, which starts at rest.  Each step sets the
    time and reads the data anew.  ``history`` has a row of numbers for each step so far.  If even
    the least step does not converge, the iteration ends with the state that was reached.
    Collective.  Raises InputError for times that do not ascend and, naming the time, for data that
    cannot be used at that time; after the first step this is ProcessEnded.

    Parameters
    ----------
    problem
        a :class:`~contact_locking.contact_problem.ContactProblem`
    steps
        the :class:`Steps`, or their times; the time before is 0, or the first if that is earlier
    time
        the time in data that are no expressions of t: a constant of DOLFINx, or a function that
        updates the data to a time
    restart
        a folder with a checkpoint of a step, from which the process goes on
    """

    def __init__(
        self,
        problem: Solvable[S],
        steps: Steps | Sequence[float],
        time: fem.Constant | Callable[[float], object] | None = None,
        restart: str | Path | None = None,
    ) -> None:
        self.problem, self.history = problem, Table()
        # An expression of UFL can be called as well.
        is_constant = isinstance(time, fem.Constant) or not callable(time)
        setter = partial(setattr, time, "value") if is_constant else time
        self._set_time = None if time is None else setter
        self._solver, self._monitor = problem.solver, problem.solver.monitor
        steps = steps if isinstance(steps, Steps) else Steps(times=tuple(steps))
        self._solver.problem.require_times(steps.planned)
        self._timeline = Timeline(steps)
        self._planned = self._timeline.remaining
        self._stops = steps.on_failure == "stop"
        self._halved: tuple[Finding, ...] = ()
        self._is_unbalanced = False
        self._probes: Table | None = None
        self._solutions = self._solve([] if restart is None else SavedSteps(Path(restart)).folders)

    def __next__(self) -> S:
        return next(self._solutions)

    def _update_to(self, at: float) -> None:
        """Set the time and update the problem to its data at that time; collective."""
        self._solver.problem.clock.set(at)
        if self._set_time is not None:
            self._set_time(at)
        self.problem.refresh()

    def _solve(self, paths: Sequence[Path]) -> Generator[S]:
        timeline, discrete = self._timeline, self._solver.problem
        solution: S | None = None
        last: State | None = None
        before: Moment | None = None
        discrete.set_memory(discrete.at_rest())
        for path in paths:
            saved = checkpoint.read(path, discrete, is_step=True)
            self._update_to(saved.time)
            self._halved, self.history = saved.halved, saved.history
            state = saved.restored(self._solver)
            energy = EnergyBalance.of_row(self.history.rows[-1])
            solution = self._solution(state, energy, saved.time)
            solution = self._with_history(solution, f"the step was read from {path}")
            yield solution
            timeline.skip_to(saved.time)
            # With other data than those of the saved step the state is no equilibrium.
            last, before = solution.state, Moment.of(state, solution.converged)
            discrete.set_memory(last.contacts)
        while not timeline.is_over:
            began = clocks.perf_counter()
            at = timeline.target
            try:
                if timeline.is_barred:
                    if timeline.fail():
                        continue
                    if solution is not None and self._stops:
                        words = timeline.explained(timeline.failed.get(at, ""), at, -math.inf)
                        yield self._stopped(solution, words["reason"])
                        return
                self._update_to(at)
                # The proofs of balance are asked for where a solve has failed before.
                is_unbalanced = self._is_unbalanced and self._solver.is_unbalanced()
                if is_unbalanced and timeline.fail():
                    continue
                report = self._solve_at(at, last)
            except InputError as error:
                is_misplaced = isinstance(error, Misplaced)
                if is_misplaced and self._halve(at, f"takes {error.key} too far"):
                    continue
                text = f"at t = {at:.6g} {error}" if is_misplaced else str(error)
                if solution is None:
                    raise InputError(text, error.key) from error
                if is_misplaced and self._stops:
                    yield self._stopped(solution, text)
                    return
                reason = {"converged": False, "reason": f"{error.key}: {text}", "suggestion": ""}
                reason["failure"] = "steps.data"
                raise ProcessEnded(text, error.key, self._end(solution) | reason) from error
            if report.failure == Infeasible.code:
                timeline.refuse(at, report)
            if not report.converged and timeline.refused is not None:
                timeline.failed[at] = report.reason
            self._is_unbalanced |= report.failure == "solver.unheld"
            if not report.converged and self._halve(at, f"did not converge ({report.reason})"):
                continue
            state = self._solver.state(report)
            energy, after = energy_balance(before or Moment.at_rest(state), state)
            candidate = self._solution(state, energy, at)
            if energy.defect is None:
                candidate = candidate.with_warnings(Finding("steps.restart", time=timeline.done))
            # Half the step misses a foundation between the nodes as well.
            entering = candidate.certificate.criteria.get(ENTRY)
            if (
                not candidate.converged
                and (entering is None or entering.holds)
                and self._halve(at, f"did not converge ({candidate.reason})")
            ):
                continue
            if not candidate.converged:
                # Where the process stops, its words begin with the last time.
                last_time = solution.time if solution and not self._stops else -math.inf
                words = timeline.explained(candidate.reason, at, last_time)
                candidate = candidate.with_entries(**words)
                if solution is not None and self._stops:
                    yield self._stopped(solution, candidate.reason)
                    return
            solution, before = candidate, after
            seconds = clocks.perf_counter() - began
            self.history.append(row_of(solution, self.history, at, energy, seconds))
            solution = self._with_history(solution)
            yield solution
            if not solution.converged:
                return
            timeline.succeed()
            last = solution.state
            discrete.set_memory(last.contacts)

    def _solve_at(self, at: float, last: State | None) -> Outcome:
        """Solve at the present time; collective."""
        self._monitor.step(len(self.history) + 1, self._timeline.remaining, at)
        saved = None if last is None else last.saved
        is_near = self._timeline.refused is not None
        asks = not is_near and at == self._timeline.planned and self._solver.may_lock_up
        searches = not (is_near or asks)
        report = self._solver.solve(saved, searches)
        is_over = report.converged or report.failure == Infeasible.code
        if is_over or not asks or self._locks_up_after(at):
            return report
        self._update_to(at)
        return self._solver.solve(saved)

    def _locks_up_after(self, at: float) -> bool:
        """Whether a proof shows that nothing is admissible a little later; collective."""
        beyond = at + _BEYOND * (at - self._timeline.start)
        try:
            self._update_to(beyond)
            verdict = self._solver.verdict()
        except InputError:
            return False
        finally:
            self._update_to(at)
        if verdict is None:
            return False
        report = Outcome(failure=Infeasible.code, reason=verdict.reason, suggestion=verdict.advice)
        self._timeline.refuse(beyond, report)
        return True

    def _end(self, last: S, ended: Finding | None = None) -> dict[str, Any]:
        """The entries ``steps`` and ``warnings`` of the last solution of a process that ends."""
        warnings = [*last.warnings, *self._halved[len(last.halved) :]]
        steps = {**last.facts["steps"], "halvings": len(self._halved), "ended": ended}
        return {"steps": steps, "warnings": warnings if ended is None else [ended, *warnings]}

    def _stopped(self, last: S, reason: str) -> S:
        """The last solution, with the finding that the process ends there."""
        ended = Finding("steps.ended", time=last.time, reason=reason)
        return last.with_entries(**self._end(last, ended))

    def _halve(self, at: float, failure: str) -> bool:
        """Halve the step after a failure, if it may be halved, and say so."""
        if not self._timeline.fail():
            return False
        # The line about the failed solve comes before the line that says why.
        self._monitor.finish()
        halved = Finding("steps.halved", time=at, failure=failure)
        self._halved = (*self._halved, halved)
        self._monitor.message(f"warning: {halved}")
        return True

    def _solution(self, state: SolvedState, energy: EnergyBalance, at: float) -> S:
        """The solution of a step, judged by its energy balance as well; collective."""
        return dataclasses.replace(self.problem.solution(state, energy.criteria(state)), time=at)

    def _with_history(self, solution: S, restart: str | None = None) -> S:
        """A solution with the history of the process."""
        if solution.probes is not None:
            sampled = in_step(solution.probes, len(self.history), solution.time)
            self._probes = sampled.after(self._probes or Table())
        warnings = [*solution.warnings, *self._halved, *self._solver.unused_options()]
        steps = totals(self.history, len(self._halved), self._planned)
        return dataclasses.replace(
            solution.with_entries(restart=restart, steps=steps, warnings=warnings),
            probes=self._probes,
            history=Table.of(self.history.rows),
            halved=self._halved,
        )


# Steps that differ by less than this share have the same length.
_ROUNDING = 1e-9
# The most halvings of a step, without a least step: fewer where a proof says that the body cannot
# follow the whole step.
_HALVINGS, _HALVINGS_AT_LIMIT = 6, 3


class Timeline:
    """The next time to solve at, which comes nearer after a failure.

    ``done`` is the time of the last solution, at first the ``start`` of the steps.  A failure
    halves the step, down to the least one; a success between two planned times lets the next step
    be twice as long.  ``refused`` is the earliest time since the last planned one at which a proof
    shows that no displacement is admissible, with its report.  ``failed`` maps times at which
    solves failed near it to the reasons.
    """

    def __init__(self, steps: Steps) -> None:
        self._planned, self._least = deque(steps.planned), steps.least
        self.start = self._interval_start = self.done = steps.start
        self._longest = math.inf
        self.refused: tuple[float, Outcome] | None = None
        self.failed: dict[float, str] = {}

    @property
    def is_over(self) -> bool:
        """Whether the last planned time is done."""
        return not self._planned

    @property
    def target(self) -> float:
        """The next time to solve at."""
        planned = self.planned
        is_near = planned - self.done <= self._longest * (1.0 + _ROUNDING)
        return planned if is_near else self.done + self._longest

    @property
    def planned(self) -> float:
        """The next planned time."""
        return self._planned[0]

    @property
    def remaining(self) -> int:
        """The number of planned times after those that are done."""
        return len(self._planned)

    def skip_to(self, time: float) -> None:
        """Count the times up to this one as done."""
        while self._planned and self._planned[0] <= time:
            self._interval_start = self._planned.popleft()
        self.done = time

    def succeed(self) -> None:
        """The solve at the target has converged."""
        self.done = self.target
        self._longest *= 2.0
        if self.refused is not None and self.refused[0] <= self.done:
            self.refused = None
        if self.done == self._planned[0]:
            self._interval_start = self._planned.popleft()
            self._longest, self.refused, self.failed = math.inf, None, {}

    @property
    def is_barred(self) -> bool:
        """Whether the target has failed before, or lies behind a time that is refused."""
        refused = self.refused
        return self.target in self.failed or (refused is not None and self.target >= refused[0])

    def refuse(self, time: float, report: Outcome) -> None:
        """Store a time at which nothing is admissible, with the report that proves it."""
        if self.refused is None or time < self.refused[0]:
            self.refused = time, report

    def fail(self) -> bool:
        """Halve the step after a failure at the target; False if it is too short for that."""
        half = 0.5 * (self.target - self.done)
        halvings = _HALVINGS if self.refused is None else _HALVINGS_AT_LIMIT
        least = self._least or (self.planned - self._interval_start) / 2**halvings
        if not half > 0.0 or half < least * (1.0 - _ROUNDING):
            return False
        self._longest = half
        return True

    def explained(self, reason: str, at: float, reached: float) -> dict[str, str]:
        """The reason and the suggestion of a process that ends before the refused time.

        Its last step failed to get to the time ``at``, where a solve may fail for a ``reason`` that
        says little, as this is close to the largest load that can be followed.  ``reached`` is the
        time of the last solution, -inf without one.  Empty without a refused time.
        """
        if self.refused is None:
            return {}
        time, report = self.refused
        reasons = [f"{report.reason}, at t = {time:.6g}"]
        if reached > -math.inf:
            reasons.append(f"the last time that was reached is t = {reached:.6g}")
        if time > at:
            reasons.append(f"the step to t = {at:.6g} did not converge: {reason}")
        words = {"reason": "; ".join(reasons), "suggestion": report.suggestion}
        return {"failure": report.failure, **words}
