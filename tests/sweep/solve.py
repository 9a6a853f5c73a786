"""One problem of the sweep from its seed to its outcome."""

from __future__ import annotations

import contextlib
import copy
import re
import time
import traceback
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mpi4py import MPI
from pydantic import ValidationError

from contact_locking.errors import ContactLockingError, InputError
from contact_locking.results.solution import StudySolution
from contact_locking.running.solving import SolvableStudy, solve_assembled
from contact_locking.study.assembly import StudyProblem, assemble
from contact_locking.study_file.parameters import Parameters

from . import (
    comparisons,
    derivatives,
    judge,
    pair_judge,
    reference,
    stepwise,
    swapped,
    unseen,
)
from .case import Case, Study, Truth
from .discrete import Discrete, State, discretise, state_of
from .families import case_of
from .observed import Moment, mesh_of, moment_of
from .own_body import Mesh
from .resultants import cannot_balance
from .transforms import Transform

# The outcomes of a problem; those of GOOD are what the sweep is for.
SOLVED, INFEASIBLE, REFUSED, WEDGED = "solved", "infeasible", "refused", "wedged"
NOT_SOLVED, WRONG, BROKEN, CLAIM = "not solved", "wrong", "broken", "claim"
GOOD = (SOLVED, INFEASIBLE, REFUSED, WEDGED, CLAIM)

# One problem in so many has its derivatives compared with differences of solves.
_DERIVED = 10
# Beyond this the problem is impossible for certain, Clarabel's accuracy considered.
_EXCESS = 1e-7
# Words of what the program tells of forces that grow without a limit, and of the state it leaves.
_GROWS = "grow with the penalty"
_STATE = r"penalty\.n: (\S+), penalty\.epsilon: (\S+) and friction\.regularisation: (\S+)"
# Of forces that balance each other loads and elasticity ask for a smaller share than this.
_NEEDLESS = 0.05
# Words of the criterion that asks for a finer mesh where a foundation enters between the nodes.
_MISSED = "that the nodes miss"
# Words of what the program claims about a problem that it does not solve.
_CLAIMS = (
    "infeasible",
    "cannot hold the body",
    _GROWS,
    "nothing resists",
    _MISSED,
)


@dataclass
class Outcome:
    """The outcome of a problem: ``study`` is the solved study, ``notes`` are about the checks."""

    family: str
    seed: int
    kind: str
    reason: str = ""
    row: str = ""
    tangents: int = 0
    seconds: float = 0.0
    study: Study = field(default_factory=dict)
    notes: dict[str, Any] = field(default_factory=dict)

    @property
    def is_good(self) -> bool:
        return self.kind in GOOD


def outcome_of(
    family: str, seed: int, checks: bool = False, linear: str = "auto", n: float | None = None
) -> Outcome:
    """Make, solve and judge the problem of a seed; no exception leaves.

    One in ten has its derivatives judged as well, but at the verge of what is admissible, where a
    step to one side has no solution.
    """
    case = case_of(family, seed, linear, n)
    outcome = outcome_of_case(case, checks, family, seed)
    is_drawn = seed % _DERIVED == _DERIVED - 1 and case.verge is None
    if outcome.kind == SOLVED and is_drawn:
        found = derivatives.compared(case.study, seed)
        if found is not None:
            outcome.notes["derivatives"] = max(found.errors.values(), default=0.0)
        if found is not None and found.complaint():
            outcome.kind, outcome.reason = WRONG, found.complaint()
    return outcome


def outcome_of_case(case: Case, checks: bool = True, family: str = "", seed: int = 0) -> Outcome:
    """Solve and judge; with ``checks`` the conic solver, other units and swapped sides, too."""
    outcome = Outcome(family, seed, BROKEN, study=case.study, row=case.row)
    start = time.process_time()
    try:
        _solve(case, outcome, checks)
    except (InputError, ValidationError) as error:
        message = " ".join(str(error).split())
        # What the design asks for may be refused; the counts tell how often.
        right = bool(case.row) or any(words in message for words in case.truth.messages)
        outcome.kind = REFUSED if right else NOT_SOLVED
        outcome.reason = f"refused: {message}"
    except ContactLockingError as error:
        outcome.kind, outcome.reason = BROKEN, f"{type(error).__name__}: {error}"
    except Exception:
        outcome.kind, outcome.reason = BROKEN, traceback.format_exc()
    outcome.seconds = outcome.seconds or time.process_time() - start
    return outcome


def _solve(case: Case, outcome: Outcome, checks: bool) -> None:
    comm = MPI.COMM_SELF
    problem = assemble(Parameters.model_validate(case.study), comm)
    if case.row or case.own_judge:
        _solve_pair(case, problem, outcome, checks)
        return
    if case.twin is not None:
        _solve_process(case, problem, outcome, checks)
        return
    if case.verge is not None:
        outcome.study = at_the_verge(case, problem)
        problem = assemble(Parameters.model_validate(outcome.study), comm, problem.domain)
    start = time.process_time()
    solution = solve_assembled(problem)
    outcome.seconds = time.process_time() - start
    space = solution.displacement.function_space
    discrete = discretise(problem.parameters, problem.domain, space, solution)
    discrete = unseen.with_band(case.truth, discrete)
    outcome.tangents = int(solution.summary["iterations"]["tangents"])
    _judge(case.truth, solution, discrete, outcome, checks)
    if outcome.kind == NOT_SOLVED and _GROWS in outcome.reason:
        outcome.kind = WEDGED if balances_itself(outcome.study, solution) else NOT_SOLVED


def _solve_process(case: Case, problem: StudyProblem, outcome: Outcome, checks: bool) -> None:
    """Solve all steps; with ``checks`` those of the twin, too."""
    found = _all_of(problem)
    outcome.tangents = max((int(row["tangents"]) for row in found[-1].history), default=0)
    outcome.reason = told = str(found[-1].summary["reason"])
    if not found[-1].converged:
        is_told = _GROWS in told
        outcome.kind = WEDGED if is_told else NOT_SOLVED
        is_unheld = "cannot hold the body" in told and cannot_balance(case.study, found[-1].time)
        if told.startswith("infeasible"):
            outcome.kind = INFEASIBLE
        elif _MISSED in told or is_unheld:
            outcome.kind = REFUSED
        return
    wrong = stepwise.complaint(found) or comparisons.about_other_solutions(case.truth, found[-1])
    if checks and not wrong:
        assert case.twin is not None
        twin = assemble(Parameters.model_validate(case.twin), MPI.COMM_SELF)
        wrong = stepwise.unlike(found, _all_of(twin), case.study)
    outcome.kind, outcome.reason = (WRONG, wrong) if wrong else (SOLVED, "")


def _all_of(problem: StudyProblem) -> list[StudySolution]:
    with contextlib.closing(SolvableStudy(problem)) as study:
        return list(study.solutions())


def _solve_pair(case: Case, problem: StudyProblem, outcome: Outcome, checks: bool) -> None:
    """Let the judge with elements of its own see what a user sees of all steps.

    With ``checks`` a problem of no pairs is solved in other units, turned and mirrored as well.
    """
    seen = _Seen(case.study, problem)
    told, wrong = str(seen.last.summary["reason"]), seen.complaint
    outcome.tangents = seen.tangents
    outcome.kind, outcome.reason = (WRONG, wrong) if wrong else (SOLVED, "")
    if not wrong and not seen.last.converged:
        is_claim = case.row and any(words in told for words in _CLAIMS)
        outcome.kind, outcome.reason = (CLAIM if is_claim else NOT_SOLVED), told
        times = [entry.time for entry in seen.moments] + [seen.last.time or 1.0]
        if told.startswith("infeasible") and seen.judge.rest_is_admissible(times):
            outcome.kind, outcome.reason = WRONG, f"the body at rest is admissible, but: {told}"
    elif not wrong and checks and not case.row:
        random = np.random.default_rng(outcome.seed)
        turned = Transform.fitting(random, case.study)
        domain = turned.moved(seen.last.domain)
        study = turned.study(case.study)
        other = _Seen(study, assemble(Parameters.model_validate(study), MPI.COMM_SELF, domain))
        apart = comparisons.unlike_turned(turned, study, seen.moments, other.moments)
        wrong = other.complaint or apart
        if not other.last.converged:
            wrong = f"{turned} is not solved: {other.last.summary['reason']}"
        outcome.kind, outcome.reason = (WRONG, wrong) if wrong else (SOLVED, "")


class _Seen:
    """All steps of a problem, as the judge with elements of its own sees them."""

    complaint: str
    judge: pair_judge.Judge
    moments: list[Moment]

    def __init__(self, study: Study, problem: StudyProblem) -> None:
        loads = study["loads"].values()
        entries = [entry for part in loads for entry in part if isinstance(entry, dict)]
        self._names = {entry["on"] for entry in (*entries, *study["contact"])}
        self._study = study
        self.tangents = 0
        (self.last,) = self._solutions(problem)
        found = self.judge.violations(self.moments) if self.moments else {}
        self.complaint = pair_judge.complaint(found)

    def _solutions(self, given: StudyProblem) -> list[StudySolution]:
        study, self.moments = self._study, []
        regions = set(study["material"].get("regions", {}))
        mesh: Mesh | None = None
        with contextlib.closing(SolvableStudy(given)) as made:
            for solution in made.solutions():
                tangents = int(solution.summary["iterations"]["tangents"])
                self.tangents = max(self.tangents, tangents)
                if mesh is None:
                    mesh = mesh_of(solution, self._names, regions)
                    self.judge = pair_judge.Judge(study, mesh)
                if solution.converged:
                    self.moments.append(moment_of(solution, mesh))
        return [solution]


def balances_itself(study: Study, solution: StudySolution) -> bool:
    """Whether the state that is left solves the problem with the penalties told of, without need.

    What loads and elasticity ask for is a small share of its forces, which balance each other.  So
    they do times any factor, with penalties that are larger by it: they have no limit.
    """
    told = re.search(_STATE, str(solution.summary["reason"]))
    if told is None:
        return False
    n, epsilon, length = map(float, told.groups())
    changed = copy.deepcopy(study)
    changed["penalty"] = {"n": n, "epsilon": epsilon}
    changed["friction"]["regularisation"] = length
    parameters = Parameters.model_validate(changed)
    space = solution.displacement.function_space
    discrete = discretise(parameters, solution.domain, space, solution)
    state = state_of(solution, discrete)
    is_right = not judge.complaint(judge.violations(parameters, discrete, state))
    return is_right and judge.asked_for(discrete, state) < _NEEDLESS


def at_the_verge(case: Case, problem: StudyProblem) -> Study:
    """The study with its prescribed displacements at a share of the largest that are possible."""
    discrete = discretise(problem.parameters, problem.domain, problem.u.function_space)
    assert case.verge is not None
    factor = case.verge * reference.largest_factor(discrete)
    study = copy.deepcopy(case.study)
    for condition in study["loads"]["displacements"]:
        condition["value"] = [None if v is None else factor * v for v in condition["value"]]
    return study


def _judge(
    truth: Truth, solution: StudySolution, discrete: Discrete, outcome: Outcome, checks: bool
) -> None:
    reason = str(solution.summary["reason"])
    if not solution.converged:
        outcome.kind, outcome.reason = NOT_SOLVED, reason
        if reason.startswith("infeasible"):
            _judge_infeasible(truth, discrete, outcome)
        elif any(words in reason for words in (*truth.messages, _MISSED)):
            outcome.kind = REFUSED
        return
    state = state_of(solution, discrete)
    found = judge.violations(solution.parameters, discrete, state)
    outcome.notes = {name: float(f"{value:.3g}") for name, value in found.items()}
    missed = unseen.complaint(truth, discrete, state, solution, found)
    wrong = [missed, judge.complaint(found), *comparisons.against_truth(truth, discrete, state)]
    wrong.append(comparisons.exported(solution, state))
    wrong.append(comparisons.about_other_solutions(truth, solution))
    wrong.append(comparisons.slip_of_truth(truth, discrete, state))
    wrong.append(comparisons.another(truth, solution.parameters, discrete, state))
    if checks:
        try:
            wrong.append(comparisons.against_reference(discrete, state))
        except reference.NoReference as error:
            outcome.notes["reference"] = str(error)
        beside = swapped.compared(outcome.study, solution, _rounding(discrete, state))
        if beside is not None:
            wrong.append(beside.complaint)
            outcome.notes["swapped"] = beside.note
        if comparisons.is_unique(solution.parameters):
            random = np.random.default_rng(outcome.seed)
            transform = Transform.random(random, discrete.dim, truth.homogeneous)
            told, difference = comparisons.against_transformed(
                transform, outcome.study, solution, discrete
            )
            wrong.append(told)
            outcome.notes["transformed"] = difference
    complaints = "; ".join(text for text in wrong if text)
    outcome.kind, outcome.reason = (WRONG, complaints) if complaints else (SOLVED, "")


def _rounding(discrete: Discrete, state: State) -> float:
    """The size of forces that rounding and the solver's tolerance leave in a body that is free."""
    x, size = discrete.geometry.x, float(np.abs(state.u).max(initial=0.0))
    length = float(np.ptp(x, axis=0).max())
    return 1e-9 * float(discrete.law.max()) * size * length ** (discrete.dim - 2)


def _judge_infeasible(truth: Truth, discrete: Discrete, outcome: Outcome) -> None:
    outcome.kind = INFEASIBLE
    if truth.admissible:
        outcome.kind = WRONG
        outcome.reason = f"something is admissible, but: {outcome.reason}"
        return
    try:
        excess = reference.smallest_excess(discrete)
    except reference.NoReference as error:
        outcome.notes["reference"] = str(error)
        return
    outcome.notes["excess"] = excess
    if excess < _EXCESS:
        outcome.kind = WRONG
        outcome.reason = f"possible with an excess of {excess:.1e}, but: {outcome.reason}"
