"""From parameters to solutions: assemble the problem, solve it, collect the results."""

from __future__ import annotations

import dataclasses
import re
import time
from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI

from contact_locking import study_file, wings
from contact_locking._version import __version__
from contact_locking.errors import InputError
from contact_locking.mesh.domain import Domain
from contact_locking.monitor import Attentive, Monitor
from contact_locking.parallel import on_root
from contact_locking.problem.distance import distance
from contact_locking.process.checkpoint import stored as checkpoint
from contact_locking.process.checkpoint.saved_steps import saved_steps
from contact_locking.process.loop import Steps
from contact_locking.process.of_study import certified, followers_of, of_study, solver_of
from contact_locking.results.solution import StudySolution
from contact_locking.study import assembly
from contact_locking.study.assembly import StudyProblem, assemble
from contact_locking.study_file.parameters import Parameters

_NUMBERS = re.compile(r"(?<![\w.])[-+]?\d[\d.e+-]*")


def solve(
    parameters: Parameters,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
    domain: Domain | None = None,
) -> StudySolution:
    """Solve (25)/(26) for the given parameters on one mesh; collective.

    ``domain`` is a mesh in place of the study's; the section ``adapt`` is for `adaptivity.solve`.
    With steps this is the solution of the last step, see :func:`solve_steps`.  ``petsc_options``
    override ``solver.petsc``, and both override the defaults.  ``restart`` is the folder of a run
    that saved its state on the same mesh; a restart changes the iterations and not the solution.  A
    solve that does not converge returns its last state, with ``converged`` False and the reason in
    the summary.  Raises InputError for data that cannot be used.
    """
    return deque(solve_steps(parameters, comm, monitor, petsc_options, restart, domain), maxlen=1)[
        0
    ]


def solve_steps(
    parameters: Parameters,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
    domain: Domain | None = None,
) -> Iterator[StudySolution]:
    """Solve one step after the other, and yield the solution of each; collective.

    Without steps in the parameters the one solution is that of :func:`solve`.  A step that does not
    converge is halved, down to ``steps.least``; the last solution is then not converged.
    ``restart`` is the folder of a run that saved a step of a process: the saved steps are yielded
    again, and the process goes on from the last of them.  Raises InputError for data that cannot be
    used.
    """
    monitor = Attentive(monitor or Monitor())
    start = time.perf_counter()
    if restart is not None:
        checkpoint.expect(saved_steps(Path(restart))[-1], comm)
    monitor.message("preparing the mesh and compiling forms (some seconds the first time)")
    problem = assemble(parameters, comm, domain)
    # Before the solve, because the mesh file may change during the solve.
    fingerprint = on_root(comm, lambda: study_file.fingerprint(parameters))
    for warning in problem.warnings:
        monitor.message(f"warning: {warning}")
    told = set[str]()
    for solution in _solutions(problem, monitor, petsc_options, restart):
        for warning in solution.summary["warnings"]:
            # Steps differ in the numbers of a warning; those in keys, as contact.1, tell it apart.
            words = _NUMBERS.sub("", warning)
            if words not in told:
                told.add(words)
                monitor.message(f"warning: {warning}")
        if parameters.certificate.limit and solution.converged:
            certificate = dict(solution.summary["certificate"])
            measured = _distance_to_limit(solution, monitor, petsc_options)
            certificate["errors"] = {**certificate["errors"], "penalty_measured": measured}
            solution = solution.telling(certificate=certificate)
        entries: dict[str, Any] = {"version": __version__, "fingerprint": fingerprint}
        entries["wall_seconds"] = time.perf_counter() - start
        others = tuple(other.telling(**entries) for other in solution.others)
        yield dataclasses.replace(solution.telling(**entries), others=others)


def solve_assembled(
    problem: StudyProblem,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
) -> StudySolution:
    """Solve a problem of :func:`assemble`, which can be solved only once; collective.

    Before this call ``problem.data`` may be changed, to data that no study file can describe.  With
    an ``own_energy`` the method is ``newton``, also for ``auto``.  With steps this is the solution
    of the last step.  Raises InputError for an ``own_energy`` with another method.
    """
    monitor = monitor or Monitor()
    return deque(_solutions(problem, monitor, petsc_options, restart), maxlen=1)[0]


def _solutions(
    problem: StudyProblem,
    monitor: Monitor,
    petsc_options: Mapping[str, Any] | None,
    restart: str | Path | None,
) -> Iterator[StudySolution]:
    """The solutions of an assembled problem: of the steps, or one; collective."""
    if problem.parameters.steps is not None:
        saved = [] if restart is None else saved_steps(Path(restart))
        return Steps(problem, monitor, petsc_options, saved)
    return _static(problem, monitor, petsc_options, restart)


def _static(
    problem: StudyProblem,
    monitor: Monitor,
    petsc_options: Mapping[str, Any] | None,
    restart: str | Path | None,
) -> Iterator[StudySolution]:
    """The solution of a problem without steps, with derivatives until it is done; collective."""
    if restart is not None and problem.parameters.equilibria is not None:
        raise InputError("does not go with --restart", "equilibria")
    saved = None if restart is None else checkpoint.read(restart, problem)
    solver = solver_of(problem, monitor, petsc_options)
    followers = followers_of(problem, solver, monitor)
    report = saved and checkpoint.solved_already(saved, problem, solver)
    report = report or solver.solve(None if saved is None else saved.state)
    monitor.message("computing fields and the certificate")
    state = solver.state(report)
    certificate = certified(problem.parameters, state)
    solution = of_study(problem, state, certificate, solver.derivatives(report))
    told = [*solution.summary["warnings"], *solver.unused_options()]
    start = None if restart is None else checkpoint.start_in_words(restart, report)
    solution = solution.telling(warnings=told, restart=start)
    for follower in followers:
        solution = follower.after(solution, report, None)
        follower.close()
    yield solution
    solver.close()
    problem.close()


def check(parameters: Parameters, comm: MPI.Intracomm = MPI.COMM_WORLD) -> dict[str, Any]:
    """The facts and warnings of the assembled problem, without a solve; collective."""
    return assembly.check(parameters, comm, wings.CHECKS)


def _distance_to_limit(
    solution: StudySolution, monitor: Monitor, petsc_options: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Solve the inequality on the same mesh, and measure the distance; collective."""
    if solution.parameters.steps is not None:
        return {"reason": "not measured for a process, whose past depends on n as well"}
    monitor.message("solving for n = .inf, to measure the distance")
    limit, domain = solution.parameters.limit(), solution.domain
    problem = assemble(limit, domain.comm, domain, solution.element)
    exact = solve_assembled(problem, monitor, petsc_options)
    if not exact.converged:
        return {"reason": f"not solved for n = .inf: {exact.summary['reason']}"}
    return distance(solution.displacement, exact.displacement, problem.data)
