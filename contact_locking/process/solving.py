"""From parameters to solutions: assemble the problem, solve it, collect the results."""

from __future__ import annotations

import contextlib
import dataclasses
import re
import time
from collections import deque
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

from contact_locking import study_file, wings
from contact_locking._version import __version__
from contact_locking.errors import with_key
from contact_locking.mesh.domain import Domain
from contact_locking.monitor import Attentive, Monitor
from contact_locking.parallel import on_root
from contact_locking.problem.distance import distance
from contact_locking.process.adaptivity.adaptive_loop import adapted
from contact_locking.process.checkpoint import stored as checkpoint
from contact_locking.process.checkpoint.saved_steps import saved_steps
from contact_locking.process.of_study import SolvableStudy
from contact_locking.results.history import values_of
from contact_locking.results.solution import StudySolution
from contact_locking.study import assembly
from contact_locking.study.assembly import StudyProblem, assemble, mesh_of
from contact_locking.study_file import require_parameters
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.numerics import AdaptParameters

_NUMBERS = re.compile(r"(?<![\w.])[-+]?\d[\d.e+-]*")


def solve(
    parameters: Parameters,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
) -> StudySolution:
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
) -> Iterator[StudySolution]:
    """The solutions on the adapted meshes, one after the other; collective.

    The section ``adapt`` sets the tolerance and the limits; without it the defaults hold.  The
    summary of each solution has the entry ``adapt`` with all meshes so far.  In the last summary
    ``adapt.stopped`` is the reason why there is no further mesh.  ``restart`` is the folder of a
    run with a checkpoint, on the first mesh or on a refined mesh, from which the loop goes on.

    The loop ends where the estimate of the error is not known.  Raises InputError for data that
    cannot be used.
    """
    listener = Attentive(monitor or Monitor())
    require_parameters(parameters)
    geometry, starts = parameters.mesh.geometry, [restart]

    def solve_on(domain: Domain) -> StudySolution:
        start = starts.pop() if starts else None
        (solution,) = solve_steps(parameters, comm, listener, petsc_options, start, domain)
        return solution

    first = checkpoint.refined_mesh(restart, comm) or mesh_of(parameters, comm)
    curved = () if geometry is None else geometry.curved
    return adapted(solve_on, first, parameters.adapt or AdaptParameters(), listener, curved)


def solve_steps(
    parameters: Parameters,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
    domain: Domain | None = None,
) -> Iterator[StudySolution]:
    """Solve one step after the other, and yield the solution of each; collective.

    Without steps in the parameters there is one solution.  A step that does not converge is halved,
    down to ``steps.least``; the last solution is then not converged.  ``restart`` is the folder of
    a run that saved a step of a process: the saved steps are yielded again, and the process goes on
    from the last of them.  ``domain`` is a mesh in place of the study's.  Raises InputError for
    data that cannot be used.
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
    with contextlib.closing(SolvableStudy(problem, monitor, petsc_options)) as study:
        for solution in study.solutions(restart):
            _require_columns(solution)
            for warning in solution.summary["warnings"]:
                # Steps differ in the numbers of a warning; those in keys, as contact.1, tell it
                # apart.
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


def _require_columns(solution: StudySolution) -> None:
    """Raise InputError for charts of columns that the history has not."""
    for number, chart in enumerate(solution.parameters.output.charts):
        for key, text in (("x", chart.x), ("y", chart.y)):
            key = f"output.charts.{number}.{key}"
            with_key(key, partial(values_of, text, solution.history))


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
    with contextlib.closing(SolvableStudy(problem, monitor, petsc_options)) as study:
        return deque(study.solutions(restart), maxlen=1)[0]


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
