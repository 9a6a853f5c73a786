"""The problem of a study file, which is solved and judged as the file asks."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from operator import attrgetter
from pathlib import Path
from typing import Any, Protocol

from contact_locking import wings
from contact_locking.certificate import Extras, certify
from contact_locking.certificate.solved_state import Criterion, SolvedState
from contact_locking.errors import InputError
from contact_locking.monitor import Monitor
from contact_locking.parallel import on_root
from contact_locking.process.checkpoint import stored as checkpoint
from contact_locking.process.judgement import solution_of
from contact_locking.process.loop import Process
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.results.probe_table import sample
from contact_locking.results.solution import StudySolution
from contact_locking.solver.linear.options import UserOptions
from contact_locking.solver.task import Settings, SolverReport
from contact_locking.study.assembly import StudyProblem
from contact_locking.study_file import problem_fingerprint
from contact_locking.study_file.parameters import Parameters

# The wings of sections of the study file, and of parts of its certificate.
_WINGS = {
    "sensitivities": "inverse",
    "branches": "theory",
    "equilibria": "theory",
    "certificate.constants": "theory",
    "certificate.error_bound": "theory",
    "certificate.critical_friction": "theory",
}


def settings_of(parameters: Parameters, petsc_options: Mapping[str, Any] | None = None) -> Settings:
    """The settings of a study file."""
    given = parameters.solver
    options = UserOptions({**given.petsc, **(petsc_options or {})})
    return Settings(**given.model_dump(exclude={"petsc"}), petsc=options)


class Follower(Protocol):
    """What a study asks for beside each of its solutions; collective."""

    def after(self, solution: StudySolution, report: SolverReport) -> StudySolution:
        """The solution with what is added to it."""

    def close(self) -> None:
        """Destroy the PETSc objects."""


class SolvableStudy:
    """The problem of a study file with its solver, as drivers take it; collective.

    Raises InputError for what cannot be made beside solutions, or takes a wing that is not
    installed.
    """

    def __init__(
        self,
        problem: StudyProblem,
        monitor: Monitor | None = None,
        petsc_options: Mapping[str, Any] | None = None,
    ) -> None:
        self.problem, self.parameters = problem, problem.parameters
        settings = settings_of(self.parameters, petsc_options)
        self.solver = ProblemSolver(problem, settings, monitor)
        for key, wing in _WINGS.items():
            if attrgetter(key)(self.parameters):
                wings.require(wing, key)
        made: list[Follower | None] = [follow(self) for follow in wings.FOLLOWERS]
        self._followers = [follower for follower in made if follower is not None]

    def refresh(self) -> None:
        """Put the data at the time of the clock into ``solver``."""
        self.problem.advance(self.problem.clock.now)
        self.solver.begin()

    def judged(
        self, state: SolvedState, criteria: Mapping[str, Criterion] | None = None
    ) -> StudySolution:
        """The solution in a state, with title, probes and parameters of the study file."""
        problem, parameters, asked = self.problem, self.parameters, self.parameters.certificate
        extras = Extras(asked.constants, asked.error_bound, asked.critical_friction)
        found = solution_of(state, certify(state, extras, criteria))
        fields = (problem.u, found.strain_norm, found.elastic_stress, found.locking_stress)
        units, is_plane = parameters.output.units, found.domain.dim == 2
        labels = units and units.labels(is_plane and not found.domain.axisymmetric)
        given = {item.name: getattr(found, item.name) for item in dataclasses.fields(found)}
        given["summary"] = {"title": parameters.title, "units": labels or {}, **found.summary}
        given["probes"] = (sample(problem.probes, *fields),) if len(problem.probes) else ()
        return StudySolution(**given, parameters=parameters)

    def solution(
        self, state: SolvedState, criteria: Mapping[str, Criterion] | None = None
    ) -> StudySolution:
        """The solution in a state, with all that the file asks for beside it."""
        derivatives = self.solver.derivatives(state.report)
        solution = dataclasses.replace(self.judged(state, criteria), differentiable=derivatives)
        for follower in self._followers:
            solution = follower.after(solution, state.report)
        return solution

    def solutions(self, restart: str | Path | None = None) -> Iterator[StudySolution]:
        """The solutions of the steps, or the only one; the problem can be solved once.

        ``restart`` is as for :func:`contact_locking.process.solving.solve`.
        """
        steps = self.parameters.steps
        for name in ("sensitivities",) if steps is not None else ("equilibria",):
            if restart is not None and getattr(self.parameters, name) is not None:
                raise InputError("takes all solves of a run: start without --restart", name)
        if steps is None:
            return iter([self._static(restart)])
        clock = self.problem.clock.constant
        return Process(self, steps.planned, clock, steps.least, steps.on_failure, restart)

    def _static(self, restart: str | Path | None) -> StudySolution:
        """The solution of a problem without steps, with derivatives until it is closed."""
        solver, problem, saved, report = self.solver, self.problem, None, None
        if restart is not None:
            saved = checkpoint.read(restart, problem)
            same = on_root(problem.domain.comm, lambda: problem_fingerprint(self.parameters))
            if saved.converged and saved.problem == same:
                report = saved.solved_again(solver)
        report = report or solver.solve(saved.state if saved else None)
        solver.monitor.message("computing fields and the certificate")
        solution = self.solution(solver.state(report))
        told = [*solution.summary["warnings"], *solver.unused_options()]
        start = None if restart is None else checkpoint.start_in_words(restart, report)
        return solution.telling(warnings=told, restart=start)

    def close(self) -> None:
        """Destroy the PETSc objects."""
        for follower in self._followers:
            follower.close()
        self.solver.close()
        self.problem.close()
