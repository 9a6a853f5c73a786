"""One solve of an assembled problem at its present time, and the solution with its certificate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from dolfinx import fem

from contact_locking.certificate import Certificate
from contact_locking.certificate.laws import ENTRY
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.costs.factorised import chosen
from contact_locking.errors import InputError
from contact_locking.fields import plausibility
from contact_locking.monitor import Monitor
from contact_locking.parameters import Parameters
from contact_locking.problem.assembly import Problem
from contact_locking.problem.loose_motion import LooseMotion
from contact_locking.problem.parts import describe_loose, describe_slide, loose_fields
from contact_locking.problem.system import PenalisedSystem
from contact_locking.results.body_fields import body_summary
from contact_locking.results.derived import (
    contact_summary,
    gather_contacts,
    integral,
    on_gamma_c,
)
from contact_locking.results.probe_table import sample
from contact_locking.results.solution import Solution
from contact_locking.results.uncovered_boundary import uncovered_entry
from contact_locking.solver import SavedState, Settings, SolverReport, Task
from contact_locking.solver import solve as solve_system
from contact_locking.solver.linear.options import UserOptions, require_harmless, require_names
from contact_locking.solver.target import Target

_WAY_OUT_OF_SLIDING = (
    "Press the body more, raise friction.coefficient, or hold it by loads.displacements."
)
_WAY_OUT_OF_COMPLAINTS = (
    "Raise solver.tolerance, or lower penalty.n: rounding in the strain is multiplied by 2 n."
)
_WAY_OUT_OF_ENTRY = (
    "Refine the mesh where the foundation enters: mesh.h_contact, or adapt; or take a rounder tool."
)


class Increment:
    """The solver of an assembled problem, for as many solves as there are steps; collective.

    Mesh, compiled forms and spaces are made once.  Before each solve the caller puts the problem to
    its time.  Raises InputError for an ``own_energy`` with a method other than ``newton``, and for
    harmful PETSc options.
    """

    def __init__(
        self,
        problem: Problem,
        monitor: Monitor,
        petsc_options: Mapping[str, Any] | None = None,
    ) -> None:
        given = problem.parameters.solver
        self._method = _method(problem)
        require_usable_options(problem.parameters, petsc_options)
        self._options = UserOptions({**given.petsc, **(petsc_options or {})})
        self.problem, self._monitor = problem, monitor
        self.settings = Settings(
            tolerance=given.tolerance,
            max_iterations=given.max_iterations,
            friction_tolerance=given.friction_tolerance,
            max_friction_updates=given.max_friction_updates,
            nested=given.friction == "nested",
            linear=_linear(problem),
            petsc=self._options,
        )
        self.system = PenalisedSystem(
            problem.data,
            problem.u,
            problem.constraints,
            held_by_contact=problem.free > 0,
            held_by_friction=problem.sliding > 0,
            loose=_loose_motion(problem),
        )
        material, domain = problem.material, problem.domain
        self.target = Target(
            problem.penalty,
            stiffness=material.stiffness,
            ellipticity=material.ellipticity,
            young=material.young,
            length=domain.extent(),
            volume=integral(domain, fem.Constant(domain.mesh, 1.0) * problem.data.dx),
        )

    def advance(self, time: float) -> None:
        """Put the problem to a time and forget the solution before; collective.

        Raises InputError for data that are not finite at this time.
        """
        self.problem.advance(time)
        self.system.assemble_loads()
        self.system.clear()

    def solve(self, saved: SavedState | None = None) -> SolverReport:
        """Solve at the present time, from a saved state if that helps; collective."""
        task = Task(self.system, self.target, self.settings, self._monitor)
        return solve_system(self._method, task, saved)

    def state(self, report: SolverReport) -> SolvedState:
        """The solved state with its stresses and tractions; collective."""
        self.system.set_penalty(self.problem.penalty)
        return SolvedState.of(self.problem, self.system, self.target, self.settings, report)

    def unused_options(self) -> list[str]:
        """A warning about PETSc options that no solve has used."""
        unused = self._options.unused()
        if not unused:
            return []
        names = ", ".join(unused)
        return [f"PETSc has not used these options: {names} (solver.petsc, or after --)"]


def require_usable_options(
    parameters: Parameters, petsc_options: Mapping[str, Any] | None = None
) -> None:
    """Raise InputError for a harmful PETSc option, or one that is no option."""
    for options, section in (
        (parameters.solver.petsc, "solver.petsc"),
        (petsc_options or {}, None),
    ):
        require_names(options, section)
        require_harmless(options, section)


def solution_of(state: SolvedState, certificate: Certificate) -> Solution:
    """The fields, the contact points and the summary of a solved state; collective."""
    problem, body, indicator = state.problem, state.body, certificate.indicator
    points, facets = gather_contacts(state.contacts, problem.domain)
    fields = (problem.u, body.strain_norm, body.elastic_stress, body.locking_stress)
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
        locking_parts=body.locking_parts,
        error_indicator=indicator and indicator.field,
        elastic_error_indicator=indicator and indicator.elastic_field,
        error_bound=certificate.error_bound,
        contacts=state.contacts,
        contact_points=points,
        contact_facets=facets,
        summary=_summary(state, certificate),
        probes=(sample(problem.probes, *fields),) if len(problem.probes) else (),
        **on_gamma_c(state.contacts, problem.u),
    )


def _loose_motion(problem: Problem) -> LooseMotion | None:
    """The rigid motions that contact alone stops, None if there are none; collective."""
    if not problem.free:
        return None
    domain, space, constraints = problem.domain, problem.u.function_space, problem.constraints
    owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
    motions = loose_fields(domain, space, constraints)
    return LooseMotion(domain.comm, motions, owned, constraints, problem.contacts)


def _linear(problem: Problem) -> str:
    """The linear solver of the study file, with the choice for this body made; collective."""
    domain, size = problem.domain, problem.constraints.space.dofmap.index_map.size_global
    compact = domain.compact_size(size * domain.dim, problem.element.degree)
    return chosen(problem.parameters.solver.linear, domain.dim, compact)


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
    if not min(problem.penalty.regularisations, default=1.0) > 0.0:
        raise InputError(
            "an energy of the user's own is solved by Newton's method, which needs a positive "
            "length",
            "friction.regularisation",
        )
    return "newton"


def _summary(state: SolvedState, certificate: Certificate) -> dict[str, Any]:
    """summary.json, but for what only the caller knows; collective."""
    problem, report, target, body = state.problem, state.report, state.target, state.body
    domain, data, u = problem.domain, problem.data, problem.u
    slide = None
    if problem.free and not report.converged:
        slide = describe_slide(domain, u.function_space, data, problem.constraints)
    if slide is None and data.tools and problem.free and not report.converged:
        slide = describe_loose(domain, u.function_space, data, problem.constraints)
    warnings = [*problem.warnings, *report.warnings]
    numbers = body_summary(domain, u, data, body)
    touching = contact_summary(state.contacts, data.tools, domain.dim)
    if report.converged:
        warnings += plausibility.about_the_strain(numbers["strain_norm_max"])
        warnings += plausibility.about_the_overstrain(
            body.largest_overstrain(domain), target.penalty.n, target.young
        )
        entering = [fields.penetration(fields.free) for fields in state.contacts]
        held = [fields.penetration(~fields.free) for fields in state.contacts]
        warnings += plausibility.about_held_nodes(
            [fields.contact.key for fields in state.contacts], held, state.largest_displacement
        )
        if problem.sliding and not any(
            contact.friction.depends_on_slip for contact in data.contacts
        ):
            warnings += plausibility.about_the_friction_used(touching["friction_used"])
        for fields in state.contacts:
            between = fields.entry
            warnings += plausibility.about_an_entry(
                fields.contact.key, between.depth, between.share, between.place
            )
        for contact in data.contacts:
            entry = uncovered_entry(domain, u, contact)
            warnings += plausibility.about_uncovered_boundary(
                contact.key, entry.depth, entry.place, state.largest_displacement
            )
        warnings += plausibility.about_the_penetration(
            max(entering, default=0.0),
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
        "reactions": certificate.reactions,
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
    solved = certificate.criteria[ENTRY].holds if state.contacts else True
    if report.converged and certificate.complaint:
        summary |= {
            "converged": False,
            "reason": certificate.complaint,
            "suggestion": _WAY_OUT_OF_COMPLAINTS if solved else _WAY_OUT_OF_ENTRY,
        }
    return summary
