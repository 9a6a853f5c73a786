"""From a study file to solutions: its problem with its solver, which drivers take."""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections import deque
from collections.abc import Iterator, Mapping
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any, Protocol

from mpi4py import MPI

from contact_locking import study_file, wings
from contact_locking._version import __version__
from contact_locking.certificate.solved_state import Criterion, SolvedState
from contact_locking.errors import InputError, with_key
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import on_root
from contact_locking.process import checkpoint
from contact_locking.process.adaptive_meshes import adapted
from contact_locking.process.checkpoint import SavedSteps
from contact_locking.process.loop import Process
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.results.probes import sample
from contact_locking.results.solution import Solution
from contact_locking.running.assembly import StudyProblem, assemble, mesh_of
from contact_locking.solver.monitor import Monitor
from contact_locking.solver.settings import Adaptation, Settings
from contact_locking.solver.task import Outcome
from contact_locking.study_file import problem_fingerprint, require_parameters
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
    options = {**parameters.solver.petsc, **(petsc_options or {})}
    return parameters.solver.model_copy(update={"petsc": options})


class Follower(Protocol):
    """Further results that a study asks for after each of its solutions; collective."""

    def after(self, solution: Solution, report: Outcome) -> Solution:
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
        self._fingerprint = on_root(
            problem.domain.comm, lambda: problem_fingerprint(self.parameters)
        )
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
    ) -> Solution:
        """The solution in a state, with title, probes and parameters of the study file."""
        problem, parameters = self.problem, self.parameters
        solution = self.solver.solution(state, criteria, parameters.certificate)
        labels = parameters.output.labels(solution.domain.dim, solution.domain.axisymmetric)
        facts = {"title": parameters.title, "units": labels, **solution.facts}
        probes = sample(problem.probes, solution) if len(problem.probes) else None
        return dataclasses.replace(
            solution, facts=facts, probes=probes, parameters=parameters, problem=self._fingerprint
        )

    def solution(
        self, state: SolvedState, criteria: Mapping[str, Criterion] | None = None
    ) -> Solution:
        """The solution in a state, with all that the file asks for beside it."""
        derivatives = self.solver.derivatives(state.report)
        solution = dataclasses.replace(self.judged(state, criteria), differentiable=derivatives)
        for follower in self._followers:
            solution = follower.after(solution, state.report)
        return solution

    def solutions(self, restart: str | Path | None = None) -> Iterator[Solution]:
        """The solutions of the steps, or the only one; the problem can be solved once.

        ``restart`` is as for :func:`contact_locking.running.solving.solve`.
        """
        steps, solver, problem = self.parameters.steps, self.solver, self.problem
        for name in ("sensitivities",) if steps is not None else ("equilibria",):
            if restart is not None and getattr(self.parameters, name) is not None:
                raise InputError("takes all solves of a run: start without --restart", name)
        if steps is not None:
            yield from Process(self, steps, None, restart)
            return
        saved, report, start = None, None, None
        if restart is not None:
            saved = checkpoint.read(restart, problem)
            if saved.converged and saved.problem == self._fingerprint:
                report = saved.solved_again(solver)
        report = report or solver.solve(saved.state if saved else None)
        if restart is not None:
            start = checkpoint.start_in_words(restart, report)
        solver.monitor.message("computing fields and the certificate")
        solution = self.solution(solver.state(report))
        yield solution.with_warnings(*solver.unused_options()).with_entries(restart=start)

    def close(self) -> None:
        """Destroy the PETSc objects."""
        for follower in self._followers:
            follower.close()
        self.solver.close()
        self.problem.close()


def solve(
    parameters: Parameters,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
) -> Solution:
    """Solve (25)/(26) for the given parameters; collective.

    With steps this is the solution of the last step, see :func:`solve_steps`, and with a section
    ``adapt`` that on the last mesh, see :func:`solve_adaptively`.  ``petsc_options`` override
    ``solver.petsc``, and both override the defaults.  ``restart`` is the folder of a run that saved
    its state; a restart changes the iterations and not the solution.  A solve that does not
    converge returns its last state, with ``converged`` False and the reason in the summary.  Raises
    InputError for data that cannot be used.
    """
    require_parameters(parameters)
    if parameters.adapt is not None:
        solutions = solve_adaptively(parameters, comm, monitor, petsc_options, restart)
    else:
        domain = checkpoint.refined_mesh(restart, comm)
        solutions = solve_steps(parameters, comm, monitor, petsc_options, restart, domain)
    # Only the last solution is kept in memory.
    return deque(solutions, maxlen=1)[0]


def solve_adaptively(
    parameters: Parameters,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
) -> Iterator[Solution]:
    """The solutions on the adapted meshes, one after the other; collective.

    The section ``adapt`` sets the tolerance and the limits; without it the defaults hold.  The
    summary of each solution has the entry ``adapt`` with all meshes so far.  In the last summary
    ``adapt.stopped`` is the reason why there is no further mesh.  ``restart`` is the folder of a
    run with a checkpoint, on the first mesh or on a refined mesh, from which the loop goes on.

    The loop ends where the estimate of the error is not known.  Raises InputError for data that
    cannot be used.
    """
    listener = monitor or Monitor()
    require_parameters(parameters)
    geometry, starts = parameters.mesh.geometry, [restart]

    def solve_on(domain: Domain) -> Solution:
        start = starts.pop() if starts else None
        (solution,) = solve_steps(parameters, comm, listener, petsc_options, start, domain)
        return solution

    first = checkpoint.refined_mesh(restart, comm) or mesh_of(parameters, comm)
    curved = () if geometry is None else geometry.curved
    return adapted(solve_on, first, parameters.adapt or Adaptation(), listener, curved)


def solve_steps(
    parameters: Parameters,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
    domain: Domain | None = None,
) -> Iterator[Solution]:
    """Solve one step after the other, and yield the solution of each; collective.

    Without steps in the parameters there is one solution.  A step that does not converge is halved,
    down to ``steps.least``; the last solution is then not converged.  ``restart`` is the folder of
    a run that saved a step of a process: the saved steps are yielded again, and the process goes on
    from the last of them.  ``domain`` is a mesh in place of the study's.  Raises InputError for
    data that cannot be used.
    """
    monitor = monitor or Monitor()
    start = time.perf_counter()
    if restart is not None:
        last = SavedSteps(Path(restart)).folders[-1]
        on_root(comm, lambda: checkpoint.require(last))
    monitor.message("preparing the mesh and compiling forms (some seconds the first time)")
    problem = assemble(parameters, comm, domain)
    # Before the solve, because the mesh file may change during the solve.
    fingerprint = on_root(comm, lambda: study_file.fingerprint(parameters))
    for finding in problem.findings:
        monitor.message(f"warning: {finding}")
    said = {(finding.code, finding.key) for finding in problem.findings}
    with contextlib.closing(SolvableStudy(problem, monitor, petsc_options)) as study:
        for solution in study.solutions(restart):
            for number, chart in enumerate(parameters.output.charts):
                for axis in ("x", "y"):
                    values = partial(solution.history.values, getattr(chart, axis))
                    with_key(f"output.charts.{number}.{axis}", values)
            for warning in solution.warnings:
                # The findings of several steps differ in their numbers.
                if (about := (warning.code, warning.key)) not in said:
                    said.add(about)
                    monitor.message(f"warning: {warning}")
            entries: dict[str, Any] = {"version": __version__, "fingerprint": fingerprint}
            entries["wall_seconds"] = time.perf_counter() - start
            others = tuple(other.with_entries(**entries) for other in solution.others)
            yield dataclasses.replace(solution.with_entries(**entries), others=others)


def solve_assembled(
    problem: StudyProblem,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
) -> Solution:
    """Solve a problem of :func:`assemble`, which can be solved only once; collective.

    Before this call ``problem.data`` may be changed, to data that no study file can describe.  With
    steps this is the solution of the last step.
    """
    with contextlib.closing(SolvableStudy(problem, monitor, petsc_options)) as study:
        return deque(study.solutions(restart), maxlen=1)[0]
