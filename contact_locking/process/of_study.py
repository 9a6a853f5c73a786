"""What a study file asks for: the solver, the judgement, and what wings make beside solutions."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Protocol

from contact_locking import wings
from contact_locking.certificate import Certificate, Extras, certify
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.monitor import Monitor
from contact_locking.process.judgement import solution_of
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.results.probe_table import sample
from contact_locking.results.solution import Differentiable, StudySolution
from contact_locking.solver.linear.options import UserOptions
from contact_locking.solver.task import Settings, SolverReport
from contact_locking.study.assembly import StudyProblem
from contact_locking.study_file.parameters import Parameters

# The wings of sections of the study file, and of parts of its certificate.
_SECTIONS = {"sensitivities": "inverse", "branches": "theory", "equilibria": "theory"}
_PARTS = ("constants", "error_bound", "critical_friction")


def settings_of(parameters: Parameters, petsc_options: Mapping[str, Any] | None = None) -> Settings:
    """The settings of a study file."""
    given = parameters.solver
    return Settings(
        method=given.method,
        tolerance=given.tolerance,
        max_iterations=given.max_iterations,
        friction_tolerance=given.friction_tolerance,
        max_friction_updates=given.max_friction_updates,
        linear=given.linear,
        petsc=UserOptions({**given.petsc, **(petsc_options or {})}),
    )


def solver_of(
    problem: StudyProblem,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
) -> ProblemSolver:
    """The solver that a study file asks for; collective."""
    return ProblemSolver(problem, settings_of(problem.parameters, petsc_options), monitor)


def certified(parameters: Parameters, state: SolvedState) -> Certificate:
    """The certificate of a state with the extra parts that a study file requests; collective."""
    wanted = parameters.certificate
    extras = Extras(wanted.constants, wanted.error_bound, wanted.critical_friction)
    return certify(state, extras)


def of_study(
    problem: StudyProblem,
    state: SolvedState,
    certificate: Certificate,
    differentiable: Differentiable | None = None,
) -> StudySolution:
    """The solution in a state, with title, probes and parameters of the study file; collective."""
    found, parameters = solution_of(state, certificate, differentiable), problem.parameters
    fields = (problem.u, found.strain_norm, found.elastic_stress, found.locking_stress)
    probes = (sample(problem.probes, *fields),) if len(problem.probes) else ()
    given = {item.name: getattr(found, item.name) for item in dataclasses.fields(found)}
    units, is_plane = parameters.output.units, found.domain.dim == 2
    labels = units and units.labels(is_plane and not found.domain.axisymmetric)
    given["summary"] = {"title": parameters.title, "units": labels or {}, **found.summary}
    return StudySolution(**given, parameters=parameters, probes=probes)


class Follower(Protocol):
    """What a study asks for beside each of its solutions; collective."""

    def after(
        self, solution: StudySolution, report: SolverReport, time: float | None
    ) -> StudySolution:
        """The solution with what is added to it; ``time`` is the end of a step."""

    def close(self) -> None:
        """Destroy the PETSc objects."""


def followers_of(problem: StudyProblem, solver: ProblemSolver, monitor: Monitor) -> list[Follower]:
    """Made before the first solve; collective.

    Raises InputError for what cannot be followed, or takes a wing that is not installed.
    """
    parameters = problem.parameters
    for name, wing in _SECTIONS.items():
        if getattr(parameters, name) is not None:
            wings.require(wing, name)
    for name in _PARTS:
        if getattr(parameters.certificate, name):
            wings.require("theory", f"certificate.{name}")
    made = (follow(problem, solver, monitor) for follow in wings.FOLLOWERS)
    return [follower for follower in made if follower is not None]
