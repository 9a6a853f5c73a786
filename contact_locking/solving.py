"""From parameters to a solution: assemble the problem, solve it, collect the results."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dolfinx import fem
from mpi4py import MPI

from contact_locking import checkpoint, study_file
from contact_locking._version import __version__
from contact_locking.certificate import Certificate, certify
from contact_locking.certificate.penalty_error import distance
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.checkpoint.restart import Restart
from contact_locking.errors import InputError
from contact_locking.monitor import Monitor
from contact_locking.parallel import on_root
from contact_locking.parameters import Parameters
from contact_locking.problem import plausibility
from contact_locking.problem.assembly import Problem, assemble
from contact_locking.problem.parts import describe_slide
from contact_locking.problem.system import PenalisedSystem
from contact_locking.results.derived import (
    body_summary,
    contact_summary,
    gather_contacts,
    integral,
    on_gamma_c,
)
from contact_locking.results.solution import Solution
from contact_locking.solver import Settings, SolverReport, Task
from contact_locking.solver import solve as solve_system
from contact_locking.solver.linear.options import UserOptions, require_harmless, require_names
from contact_locking.solver.target import Target

_WAY_OUT_OF_SLIDING = (
    "Press the body more, raise friction.coefficient, or hold it by loads.displacements."
)
_WAY_OUT_OF_COMPLAINTS = (
    "Raise solver.tolerance, or lower penalty.n: rounding in the strain is multiplied by 2 n."
)


def solve(
    parameters: Parameters,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
) -> Solution:
    """Solve (25)/(26) for the given parameters; collective.

    ``petsc_options`` override ``solver.petsc``, and both override the defaults.  ``restart`` is the
    folder of a run that saved its state on the same mesh; a restart changes the iterations and not
    the solution.  A solve that does not converge returns its last state, with ``converged`` False
    and the reason in the summary.  Raises InputError for data that cannot be used.
    """
    monitor = monitor or Monitor()
    start = time.perf_counter()
    if restart is not None:
        checkpoint.expect(restart, comm)
    _require_usable_options(parameters, petsc_options)
    monitor.message("preparing the mesh and compiling forms (some seconds the first time)")
    problem = assemble(parameters, comm)
    # Before the solve, because the mesh file may change during the solve.
    fingerprint = on_root(comm, lambda: study_file.fingerprint(parameters))
    for warning in problem.warnings:
        monitor.message(f"warning: {warning}")
    solution = solve_assembled(problem, monitor, petsc_options, restart)
    for warning in solution.summary["warnings"][len(problem.warnings) :]:
        monitor.message(f"warning: {warning}")
    if parameters.certificate.limit and solution.converged:
        _measure_against_limit(solution, monitor, petsc_options)
    solution.summary["version"] = __version__
    solution.summary["fingerprint"] = fingerprint
    solution.summary["wall_seconds"] = time.perf_counter() - start
    return solution


def solve_assembled(
    problem: Problem,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
) -> Solution:
    """Solve a problem of :func:`assemble`, which can be solved only once; collective.

    Before this call ``problem.data`` may be changed, to data that no study file can describe.  With
    an ``own_energy`` the method is ``newton``, also for ``auto``.  Raises InputError for an
    ``own_energy`` with another method.
    """
    monitor = monitor or Monitor()
    restarted = None if restart is None else Restart(restart, problem)
    given = problem.parameters.solver
    method = _method(problem)
    _require_usable_options(problem.parameters, petsc_options)
    options = UserOptions({**given.petsc, **(petsc_options or {})})
    settings = Settings(
        tolerance=given.tolerance,
        max_iterations=given.max_iterations,
        friction_tolerance=given.friction_tolerance,
        max_friction_updates=given.max_friction_updates,
        nested=given.friction == "nested",
        linear=given.linear,
        petsc=options,
    )
    system = PenalisedSystem(
        problem.data,
        problem.u,
        problem.constraints,
        held_by_contact=problem.free > 0,
        held_by_friction=problem.sliding > 0,
    )
    material, domain = problem.material, problem.domain
    target = Target(
        problem.penalty,
        stiffness=material.stiffness,
        ellipticity=material.ellipticity,
        young=material.young,
        length=domain.extent(),
        volume=integral(domain, fem.Constant(domain.mesh, 1.0) * problem.data.dx),
    )
    report = None if restarted is None else restarted.solved_already(system, target, settings)
    if report is None:
        saved = None if restarted is None else restarted.state
        report = solve_system(method, Task(system, target, settings, monitor), saved)
    system.set_penalty(problem.penalty)
    monitor.message("computing fields and the certificate")
    solution = _collect(problem, system, target, report, settings)
    if unused := options.unused():
        solution.summary["warnings"].append(
            f"PETSc has not used these options: {', '.join(unused)} (solver.petsc, or after --)"
        )
    solution.summary["restart"] = None if restarted is None else restarted.told(report)
    problem.close()
    return solution


def check(parameters: Parameters, comm: MPI.Intracomm = MPI.COMM_WORLD) -> dict[str, Any]:
    """The facts and warnings of the assembled problem, without a solve; collective."""
    _require_usable_options(parameters)
    problem = assemble(parameters, comm)
    problem.close()
    return {**problem.facts(), "warnings": problem.warnings}


def _require_usable_options(
    parameters: Parameters, petsc_options: Mapping[str, Any] | None = None
) -> None:
    """Raise InputError for a harmful PETSc option, or one that is no option."""
    for options, section in (
        (parameters.solver.petsc, "solver.petsc"),
        (petsc_options or {}, None),
    ):
        require_names(options, section)
        require_harmless(options, section)


def _method(problem: Problem) -> str:
    method = problem.parameters.solver.method
    if problem.data.own_energy is None:
        return method
    if method == "interior_point":
        raise InputError(
            "interior_point does not know an energy of the user's own; take newton, or auto",
            "solver.method",
        )
    if not math.isfinite(problem.parameters.penalty.n):
        raise InputError(
            "an energy of the user's own is solved by Newton's method, which takes a finite n "
            "such as 1e6",
            "penalty.n",
        )
    return "newton"


def _collect(
    problem: Problem,
    system: PenalisedSystem,
    target: Target,
    report: SolverReport,
    settings: Settings,
) -> Solution:
    domain, data, u = problem.domain, problem.data, problem.u
    state = SolvedState.of(problem, system, target, settings, report)
    body = state.body
    certificate = certify(state)
    slide = None
    if problem.sliding and not report.converged:
        slide = describe_slide(domain, u.function_space, data, problem.constraints)
    warnings = [*problem.warnings]
    numbers = body_summary(domain, u, data, body)
    touching = contact_summary(state.contacts, domain.dim)
    if report.converged:
        warnings += plausibility.about_the_strain(numbers["strain_norm_max"])
        warnings += plausibility.about_the_overstrain(
            body.largest_overstrain(domain), target.penalty.n, target.young
        )
        warnings += plausibility.about_the_penetration(
            touching["penetration_max"],
            state.largest_displacement,
            target.penalty.epsilon,
            target.length / target.young,
            follows_n=problem.parameters.penalty.epsilon is None,
        )
    summary: dict[str, Any] = {
        "title": problem.parameters.title,
        "converged": report.converged,
        "reason": f"{slide}; {report.reason}" if slide else report.reason,
        "suggestion": _WAY_OUT_OF_SLIDING if slide else report.suggestion,
        **numbers,
        **touching,
        "iterations": {
            "tangents": report.tangents,
            "linear": report.linear,
            "friction": report.friction,
        },
        "residual": certificate.residual,
        "friction_fixed_point": {
            "change": report.friction_change,
            "contraction": report.contraction,
        },
        "penalty": {
            "n": target.penalty.n,
            "epsilon": target.penalty.epsilon,
            "regularisation": max(target.penalty.regularisations, default=0.0),
        },
        "duality_gap": report.duality_gap,
        "admissible_load_factor": report.admissible_factor and list(report.admissible_factor),
        "stages": report.stages,
        "bounds": certificate.bounds,
        "certificate": certificate.summary(),
        "warnings": warnings,
    }
    load = certificate.limit_load
    if not report.converged and load is not None and load["infeasible"]:
        most = f"{100.0 * load['load_factor'][1]:.3g}"
        summary["reason"] += f"; on no mesh can more than {most} % of them be followed"
    if report.converged and certificate.complaint:
        summary |= {
            "converged": False,
            "reason": certificate.complaint,
            "suggestion": _WAY_OUT_OF_COMPLAINTS,
        }
    return _solution(problem, state, certificate, summary)


def _measure_against_limit(
    solution: Solution, monitor: Monitor, petsc_options: Mapping[str, Any] | None
) -> None:
    """Solve the inequality on the same mesh and add the distance to the certificate; collective."""
    monitor.message("solving for n = .inf, to measure the distance")
    limit, domain = solution.parameters.limit(), solution.domain
    problem = assemble(limit, domain.comm, domain, solution.element)
    exact = solve_assembled(problem, monitor, petsc_options)
    measured: dict[str, Any]
    if exact.converged:
        measured = distance(solution.displacement, exact.displacement, problem.data)
    else:
        measured = {"reason": f"not solved for n = .inf: {exact.summary['reason']}"}
    solution.summary["certificate"]["errors"]["penalty_measured"] = measured


def _solution(
    problem: Problem, state: SolvedState, certificate: Certificate, summary: dict[str, Any]
) -> Solution:
    body = state.body
    points, facets = gather_contacts(state.contacts, problem.domain)
    return Solution(
        parameters=problem.parameters,
        domain=problem.domain,
        element=problem.element,
        displacement=problem.u,
        strain_norm=body.strain_norm,
        locking_limit=body.locking_limit,
        locked=body.locked,
        elastic_stress=body.elastic_stress,
        locking_stress=body.locking_stress,
        error_indicator=certificate.error_indicator,
        contacts=state.contacts,
        contact_points=points,
        contact_facets=facets,
        summary=summary,
        **on_gamma_c(state.contacts, problem.u),
    )
