"""Settings of solver and certificate from a study file, and its additions to a solution."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from contact_locking.certificate import Extras
from contact_locking.monitor import Monitor
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.results.probe_table import sample
from contact_locking.results.solution import Solution, StudySolution
from contact_locking.solver.linear.options import UserOptions, require_usable
from contact_locking.solver.task import Settings
from contact_locking.study.assembly import StudyProblem
from contact_locking.study_file.parameters import Parameters


def settings_of(parameters: Parameters, petsc_options: Mapping[str, Any] | None = None) -> Settings:
    """The settings of a study file.  Raises InputError for harmful PETSc options."""
    given = parameters.solver
    require_usable_options(parameters, petsc_options)
    return Settings(
        method=given.method,
        tolerance=given.tolerance,
        max_iterations=given.max_iterations,
        friction_tolerance=given.friction_tolerance,
        max_friction_updates=given.max_friction_updates,
        nested=given.friction == "nested",
        linear=given.linear,
        petsc=UserOptions({**given.petsc, **(petsc_options or {})}),
    )


def require_usable_options(
    parameters: Parameters, petsc_options: Mapping[str, Any] | None = None
) -> None:
    """Raise InputError for a harmful PETSc option, or one that is no option."""
    for options, section in (
        (parameters.solver.petsc, "solver.petsc"),
        (petsc_options or {}, None),
    ):
        require_usable(options, section)


def solver_of(
    problem: StudyProblem,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
) -> ProblemSolver:
    """The solver that a study file asks for; collective."""
    return ProblemSolver(problem, settings_of(problem.parameters, petsc_options), monitor)


def extras_of(parameters: Parameters) -> Extras:
    """The extra parts of the certificate that a study file requests."""
    wanted = parameters.certificate
    return Extras(wanted.constants, wanted.error_bound, wanted.critical_friction)


def of_study(problem: StudyProblem, solution: Solution) -> StudySolution:
    """A solution with the title, the probes and the parameters of the study file; collective."""
    fields = (
        problem.u,
        solution.strain_norm,
        solution.elastic_stress,
        solution.locking_stress,
    )
    probes = (sample(problem.probes, *fields),) if len(problem.probes) else ()
    given = {item.name: getattr(solution, item.name) for item in dataclasses.fields(solution)}
    given["summary"] = {"title": problem.parameters.title, **solution.summary}
    return StudySolution(**given, parameters=problem.parameters, probes=probes)
