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
from contact_locking.running.assembly import StudyProblem, assemble
from contact_locking.running.solving import SolvableStudy
from contact_locking.study_file.parameters import Parameters

from . import by_segments, comparisons, derivatives, reference, unseen
from .case import Case, Study, Truth
from .elements import Mesh
from .families import case_of
from .judge import Judge, complaint
from .observed import Moment, mesh_of, moment_of, pairings_of
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
# Words of the state that the program leaves where forces grow without a limit.
_STATE = r"penalty\.n: (\S+), penalty\.epsilon: (\S+) and friction\.regularisation: (\S+)"
# Of forces that balance each other loads and elasticity ask for a smaller share than this.
_NEEDLESS = 0.05
_INFEASIBLE = ("solver.infeasible", "solver.infeasible_limit")
_UNHELD, _GROWS = "solver.unheld", "solver.forces_grow"
# The criterion that asks for a finer mesh where a foundation enters between the nodes.
_MISSED = "certificate.penetration_between_nodes"
# What the program claims about a problem that it does not solve.
_CLAIMS = (*_INFEASIBLE, _UNHELD, _GROWS, "solver.loose", _MISSED)


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
    family: str,
    seed: int,
    checks: bool = False,
    linear: str = "auto",
    n: float | None = None,
    with_derivatives: bool | None = None,
) -> Outcome:
    """Make, solve and judge the problem of a seed; no exception of a solve leaves.

    Unless it is said, one in ten has its derivatives judged as well, but at the verge of what is
    admissible, where a step to one side has no solution.
    """
    if family == by_segments.PUNCHES:
        punched = by_segments.compared(seed)
        kind = WRONG if punched.failed else SOLVED
        notes = {"by mesh": punched.by_mesh, "halved": bool(punched.coarser)}
        return Outcome(family, seed, kind, str(punched), seconds=punched.seconds, notes=notes)
    case = case_of(family, seed, linear, n)
    outcome = outcome_of_case(case, checks, family, seed)
    if with_derivatives is None:
        with_derivatives = seed % _DERIVED == _DERIVED - 1
    if outcome.kind == SOLVED and with_derivatives and case.verge is None:
        found = derivatives.compared(case.study, seed)
        if found is not None:
            errors = [(error, found.marked) for error in found.errors.values()]
            outcome.notes["derivatives"] = errors
        if found is not None and found.complaint():
            outcome.kind, outcome.reason = WRONG, found.complaint()
    return outcome


def outcome_of_case(case: Case, checks: bool = True, family: str = "", seed: int = 0) -> Outcome:
    """Solve and judge; with ``checks`` the conic solver and other units, too."""
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
    problem = assemble(Parameters.model_validate(case.study), MPI.COMM_SELF)
    if case.verge is not None:
        outcome.study = at_the_verge(case, problem)
        parameters = Parameters.model_validate(outcome.study)
        problem = assemble(parameters, MPI.COMM_SELF, problem.domain)
    start = time.process_time()
    seen = _Seen(case.truth, outcome.study, problem)
    outcome.seconds = time.process_time() - start
    outcome.tangents = seen.tangents
    if not seen.last.converged:
        outcome.kind, outcome.reason = NOT_SOLVED, str(seen.last.summary["reason"])
        _judge_unsolved(case, seen, outcome)
        return
    truth, judge, moment = case.truth, seen.judge, seen.moments[-1]
    outcome.notes = {name: float(f"{value:.3g}") for name, value in seen.found.items()}
    wrong = [seen.complaint, comparisons.about_other_solutions(truth, seen.last)]
    wrong += comparisons.against_truth(truth, judge, moment)
    wrong.append(comparisons.exported(seen.last, moment))
    wrong.append(comparisons.slip_of_truth(truth, judge, moment))
    wrong.append(comparisons.another(truth, judge, moment))
    if checks and not any(wrong) and not case.row:
        wrong += _compared(case, seen, outcome)
    complaints = "; ".join(text for text in wrong if text)
    outcome.kind, outcome.reason = (WRONG, complaints) if complaints else (SOLVED, "")


def _compared(case: Case, seen: _Seen, outcome: Outcome) -> list[str]:
    """What the conic solver and other units say of a solution; "" if nothing.

    The mesh is moved, so that this comes last.
    """
    study, judge, wrong = outcome.study, seen.judge, [""]
    moves = "steps" in study or any(contact.is_free for contact in judge.contacts)
    if not moves:
        try:
            wrong.append(comparisons.against_reference(judge, seen.moments[-1]))
        except reference.NoReference as error:
            outcome.notes["reference"] = str(error)
    if moves or comparisons.is_unique(seen.last.parameters):
        random = np.random.default_rng(outcome.seed)
        transform = Transform.random(random, study, case.truth.homogeneous)
        domain, given = transform.moved(seen.last.domain), transform.study(study)
        problem = assemble(Parameters.model_validate(given), MPI.COMM_SELF, domain)
        other = _Seen(Truth(), given, problem)
        if not other.last.converged:
            return [f"{transform} is not solved: {other.last.summary['reason']}"]
        told, outcome.notes["transformed"] = comparisons.against_transformed(
            transform, judge, seen.moments, other.moments
        )
        wrong += [told, other.complaint if moves else ""]
    return wrong


def _judge_unsolved(case: Case, seen: _Seen, outcome: Outcome) -> None:
    """Whether what is told of a problem without a solution is right."""
    told, judge, study = outcome.reason, seen.judge, outcome.study
    code = seen.last.failure
    times = [entry.time for entry in seen.moments] + [seen.last.time or 1.0]
    if seen.complaint:
        outcome.kind, outcome.reason = WRONG, seen.complaint
    elif code in _INFEASIBLE and judge.rest_is_admissible(times):
        outcome.kind, outcome.reason = WRONG, f"the body at rest is admissible, but: {told}"
    elif case.row:
        outcome.kind = CLAIM if code in _CLAIMS else NOT_SOLVED
    elif code in _INFEASIBLE:
        outcome.kind = INFEASIBLE
        if "steps" not in study:
            _judge_infeasible(case.truth, judge, outcome)
    elif code == _MISSED or any(words in told for words in case.truth.messages):
        outcome.kind = REFUSED
    elif code == _UNHELD and "steps" in study:
        is_right = cannot_balance(judge, times[-1])
        outcome.kind = REFUSED if is_right else NOT_SOLVED
    elif code == _GROWS:
        is_right = "steps" in study or balances_itself(study, seen.last)
        outcome.kind = WEDGED if is_right else NOT_SOLVED


class _Seen:
    """All steps of a problem, and what the judge finds of those that converged."""

    def __init__(self, truth: Truth, study: Study, problem: StudyProblem) -> None:
        self.tangents, self.moments = 0, list[Moment]()
        mesh: Mesh | None = None
        with contextlib.closing(SolvableStudy(problem)) as made:
            for self.last in made.solutions():
                tangents = int(self.last.summary["iterations"]["tangents"])
                self.tangents = max(self.tangents, tangents)
                if mesh is None:
                    mesh = mesh_of(problem.domain, problem.u.function_space, study)
                if self.last.converged:
                    self.moments.append(moment_of(self.last, mesh))
        assert mesh is not None
        pairings = pairings_of(problem.domain, mesh, study, self.last)
        self.judge = Judge(study, mesh, pairings)
        self.judge.given_load = unseen.load_of_band(truth, self.judge.body)
        self.found = self.judge.violations(self.moments) if self.moments else {}
        missed = ""
        if self.moments:
            warnings = self.last.summary["warnings"]
            missed = unseen.complaint(truth, self.judge, self.moments[-1], warnings, self.found)
        criteria = {n: c for moment in self.moments for n, c in moment.criteria.items()}
        failed = [f"{name} fails" for name, entry in criteria.items() if not entry["holds"]]
        parts = [complaint(self.found), missed, *failed]
        self.complaint = "; ".join(part for part in parts if part)


def judge_of(problem: StudyProblem, study: Study) -> Judge:
    """The judge of a problem that is not solved yet."""
    mesh = mesh_of(problem.domain, problem.u.function_space, study)
    return Judge(study, mesh, pairings_of(problem.domain, mesh, study))


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
    mesh = mesh_of(solution.domain, solution.displacement.function_space, changed)
    judge = Judge(changed, mesh, pairings_of(solution.domain, mesh, changed, solution))
    moment = moment_of(solution, mesh)
    is_right = not complaint(judge.violations([moment]))
    return is_right and judge.needlessness(moment) < _NEEDLESS


def at_the_verge(case: Case, problem: StudyProblem) -> Study:
    """The study with its prescribed displacements at a share of the largest that are possible."""
    assert case.verge is not None
    factor = case.verge * reference.Programme(judge_of(problem, case.study)).largest_factor()
    study = copy.deepcopy(case.study)
    for condition in study["loads"]["displacements"]:
        condition["value"] = [None if v is None else factor * v for v in condition["value"]]
    return study


def _judge_infeasible(truth: Truth, judge: Judge, outcome: Outcome) -> None:
    if truth.admissible:
        outcome.kind = WRONG
        outcome.reason = f"something is admissible, but: {outcome.reason}"
        return
    try:
        excess = reference.Programme(judge).smallest_excess()
    except reference.NoReference as error:
        outcome.notes["reference"] = str(error)
        return
    outcome.notes["excess"] = excess
    if excess < _EXCESS:
        outcome.kind = WRONG
        outcome.reason = f"possible with an excess of {excess:.1e}, but: {outcome.reason}"
