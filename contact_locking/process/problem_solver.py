"""A discrete problem with its solver, for any number of solves, and the solution of each."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import dolfinx
import numpy as np
from dolfinx import fem

from contact_locking import wings
from contact_locking.certificate.laws import ENTRY
from contact_locking.certificate.solved_state import Criterion, SolvedState
from contact_locking.certificate.verdict import Certificate, certify
from contact_locking.errors import Infeasible, NotConverged
from contact_locking.fem.compiled import integral
from contact_locking.findings import Finding
from contact_locking.parallel import maximum
from contact_locking.penalty_method import method as penalty_method
from contact_locking.penalty_method import require_served
from contact_locking.problem.discrete_problem import DiscreteProblem, distance
from contact_locking.problem.rounding import LooseMotion
from contact_locking.problem.system import System
from contact_locking.process.findings import findings
from contact_locking.results.contact_points import OPEN
from contact_locking.results.derived import BodyFields, Contacts, gather_contacts, on_gamma_c
from contact_locking.results.output import Extras
from contact_locking.results.quantities import QUANTITIES, computed
from contact_locking.results.solution import Differentiable, Solution, State
from contact_locking.solver.ksp import UserOptions, is_direct
from contact_locking.solver.monitor import Monitor
from contact_locking.solver.settings import Settings
from contact_locking.solver.strategy import Reasons, Verdict
from contact_locking.solver.strategy import solve as solve_system
from contact_locking.solver.task import Multipliers, Outcome, SavedState, Target, Task

# The most solves with bodies paired anew; usually the pairing stays after one to three.
_MOST_PAIRINGS = 8
_APART = "with the bodies paired as at the previous solution, nothing is admissible"


class ProblemSolver:
    """The solver of a discrete problem; mesh, compiled forms and spaces are made once.

    Before each solve the caller updates the problem to the present time and data.  Constructor and
    methods are collective.  Raises InputError for a problem that ``method: penalty`` cannot solve.
    """

    def __init__(
        self, problem: DiscreteProblem, settings: Settings, monitor: Monitor | None = None
    ) -> None:
        self.problem, self.monitor = problem, monitor or Monitor()
        self._derivatives: tuple[Outcome, Differentiable] | None = None
        self._method = settings.method
        if self._method == "penalty":
            require_served(problem)
        linear = linear_solver(problem, settings.linear)
        self._options = UserOptions(settings.petsc)
        self.settings = settings.model_copy(update={"petsc": self._options, "linear": linear})
        loose: LooseMotion | None = None
        if problem.free:
            _, motions = problem.rigidity.loose()
            loose = LooseMotion(motions, problem.constraints, problem.contacts)
        self.system = System(
            problem.data,
            problem.u,
            problem.constraints,
            held_by_contact=problem.free > 0,
            held_by_friction=problem.sliding > 0,
            loose=loose,
        )
        unit = fem.Constant(problem.domain.mesh, 1.0)
        self._volume = integral(problem.domain, unit * problem.data.dx)

    @property
    def target(self) -> Target:
        """The penalty parameters to solve for, and the scales of the problem."""
        material, domain = self.problem.material, self.problem.domain
        return Target(
            self.problem.penalty,
            stiffness=material.stiffness,
            ellipticity=material.ellipticity,
            young=material.young,
            length=domain.extent,
            volume=self._volume,
            # The face of a body of revolution is a surface in space.
            face=domain.extent ** (domain.kinematics.tensor_size(domain.dim) - 1),
        )

    def begin(self) -> None:
        """Assemble the present loads and reset the state to zero."""
        self.system.assemble_loads()
        self.system.clear()

    def solve(self, saved: SavedState | None = None, searches: bool = True) -> Outcome:
        """Solve for the present data; tries the ``saved`` state first.

        ``searches`` is that of :class:`Task`.  The bodies are paired anew at each solution, until
        the pairing stays.
        """
        self.close()

        def task() -> Task:
            return dataclasses.replace(
                self.task, is_unbalanced=self.is_unbalanced, searches=searches
            )

        if self._method == "penalty":
            return penalty_method.solve(task(), saved)
        report, before = solve_system(task(), saved), None
        for _ in range(_MOST_PAIRINGS):
            start = self._next_start(report, before) if report.converged else None
            if start is None:
                break
            before, report = report.multipliers, solve_system(task(), start).after(report)
            if report.failure == Infeasible.code:
                # The proof is for one pairing of the bodies only.
                reason = f"{_APART}: {report.reason}"
                report = dataclasses.replace(report, failure=NotConverged.code, reason=reason)
        else:
            unsettled = Finding("contact.unsettled", solves=_MOST_PAIRINGS)
            return dataclasses.replace(report, warnings=[*report.warnings, unsettled])
        return report

    def _next_start(self, report: Outcome, before: Multipliers | None) -> SavedState | None:
        """Pair the bodies anew at the solution; the next start, None if no pairing changed."""
        problem, system, now = self.problem, self.system, report.multipliers
        assert now is not None
        pairs = zip(now.contacts, (before or now).contacts, strict=True)
        settled = [before is not None and x.is_near(then, system.comm) for x, then in pairs]
        if not problem.update_pairs([forces.touches for forces in now.contacts], settled):
            return None
        return SavedState(
            problem.u.x.array.copy(),
            system.tools.travels,
            problem.penalty,
            report.last.cones if report.last else (),
            report.multipliers,
        )

    @property
    def task(self) -> Task:
        """The present problem for a solver."""
        return Task(self.system, self.target, self.settings, self.monitor)

    @property
    def may_lock_up(self) -> bool:
        """Whether strain limits are strict, so that perhaps nothing is admissible."""
        sets = self.system.data.sets
        limits = np.concatenate([np.zeros(1), *(law.inverse_limit.x.array for law in sets)])
        return self.target.penalty.is_strict and maximum(self.system.comm, limits) > 0.0

    def verdict(self) -> Verdict | None:
        """The proof that no displacement is admissible for the present data, or None."""
        return Reasons(dataclasses.replace(self.task, monitor=Monitor())).verdict

    def is_unbalanced(self) -> bool:
        """Whether it is proved that no forces of contact and friction balance the loads."""
        return self.problem.free > 0 and self.problem.rigidity.is_unheld()

    def derivatives(self, report: Outcome) -> Differentiable | None:
        """The derivatives of the solution of a report, valid until the next solve."""
        if self._derivatives is None or self._derivatives[0] is not report:
            self.close()
            registered = (derivatives(self, report) for derivatives in wings.DERIVATIVES)
            if (first := next(registered, None)) is not None:
                self._derivatives = report, first
        return self._derivatives and self._derivatives[1]

    def close(self) -> None:
        """Destroy the PETSc objects of derivatives."""
        if self._derivatives is not None:
            self._derivatives[1].close()
            self._derivatives = None

    def state(self, report: Outcome) -> SolvedState:
        """The solved state with its stresses and tractions."""
        return SolvedState(self.problem, self.system, self.target, self.settings, report)

    def solution(
        self,
        state: SolvedState,
        criteria: Mapping[str, Criterion] | None = None,
        extras: Extras | None = None,
        derivatives: Differentiable | None = None,
        certificate: bool = True,
    ) -> Solution:
        """The solution in a state, with its certificate unless ``certificate`` is False.

        ``criteria`` are additional ones, of a step, and ``extras`` optional parts.
        """
        judged = certify(state, extras or Extras(), criteria) if certificate else None
        solution = solution_of(state, judged, derivatives)
        if judged is None or not (extras and extras.limit and solution.converged):
            return solution
        measured = {"reason": "not measured in a process, whose earlier steps depend on n as well"}
        if criteria is None:
            measured = self._distance_to_limit(solution)
        errors = {**judged.errors, "penalty_measured": measured}
        return dataclasses.replace(solution, certificate=dataclasses.replace(judged, errors=errors))

    def _distance_to_limit(self, solution: Solution) -> dict[str, Any]:
        """The distance to the solution for n = inf on the same mesh."""
        problem, system = self.problem, self.system
        if problem.data.own_energy is not None:
            return {"reason": "not measured with a user-defined energy"}
        self.monitor.message("solving for n = .inf, to measure the distance")
        limit = dataclasses.replace(self.target, penalty=problem.penalty.inequality())
        with system.preserved():
            system.clear()
            report = solve_system(dataclasses.replace(self.task, target=limit))
            exact = problem.u.copy()
        if not report.converged:
            return {"reason": f"not solved for n = .inf: {report.reason}"}
        return distance(solution.displacement, exact, problem.data)

    def unused_options(self) -> list[Finding]:
        """A finding that names the PETSc options that no solve has used, or nothing."""
        unused = self._options.unused()
        return [Finding("solver.unused_options", names=", ".join(unused))] if unused else []


def linear_solver(problem: DiscreteProblem, linear: str) -> str:
    """``linear``, with auto replaced by the choice for this body; collective."""
    domain, size = problem.domain, problem.constraints.space.dofmap.index_map.size_global
    compact = domain.compact_size(size * domain.dim, problem.element.degree)
    return "direct" if is_direct(linear, domain.dim, compact) else "iterative"


_SLIDING_ADVICE = (
    "Press the body more, lower the loads that move it, raise friction.coefficient, or hold it by "
    "loads.displacements."
)
_ENTRY_ADVICE = (
    "Refine the mesh where the foundation enters: mesh.h_contact or mesh.h; or use a rounder "
    "foundation."
)
_CRITERION_ADVICE = (
    "Raise solver.tolerance, or lower penalty.n: rounding in the strain is multiplied by 2 n."
)


def solution_of(
    state: SolvedState,
    certificate: Certificate | None,
    differentiable: Differentiable | None = None,
) -> Solution:
    """The solution with the fields, contact points and numbers of a solved state; collective.

    Without a certificate only the solver decides whether it has converged.
    """
    problem, body, report = state.problem, state.body, state.report
    indicator = certificate.indicator if certificate else None
    points, facets = gather_contacts(state.contacts, problem.domain)
    # The next solve overwrites the displacement of the problem.
    displacement = problem.u.copy()
    displacement.name = problem.u.name
    failure, reason, suggestion = report.failure, report.reason, report.suggestion
    if problem.free and not report.converged:
        code, slide = "solver.unheld", problem.rigidity.describe_slide()
        if slide is None and problem.data.tools:
            code, slide = "solver.loose", problem.rigidity.describe_loose()
        if slide is not None:
            failure = failure if failure == "solver.forces_grow" else code
            reason, suggestion = f"{slide}; {reason}", _SLIDING_ADVICE
    warnings = [*problem.findings, *report.warnings]
    if report.converged:
        warnings += findings(state)
    if certificate is not None:
        warnings += certificate.proofs.warnings
        if not report.converged and certificate.proofs.reason:
            reason += f"; {certificate.proofs.reason}"
        if report.converged and certificate.complaint:
            broken = [name for name, each in certificate.criteria.items() if not each.holds]
            enters = ENTRY in broken
            failure = f"certificate.{ENTRY if enters else [*broken, 'proofs'][0]}"
            reason = certificate.complaint
            suggestion = _ENTRY_ADVICE if enters else _CRITERION_ADVICE
    return Solution(
        domain=problem.domain,
        element=problem.element,
        displacement=displacement,
        **{name: getattr(body, name) for name in BodyFields.FIELDS},
        error_indicator=indicator and indicator.field,
        elastic_error_indicator=indicator and indicator.elastic_field,
        contacts=state.contacts,
        contact_points=points,
        contact_facets=facets,
        state=state_of(state),
        facts=_facts(state),
        converged=report.converged and not (certificate and certificate.complaint),
        failure=failure,
        reason=reason,
        suggestion=suggestion,
        warnings=warnings,
        certificate=certificate,
        report=report,
        differentiable=differentiable,
        data=problem.data,
        **on_gamma_c(state.contacts, problem.u),
    )


def state_of(state: SolvedState) -> State:
    """A copy of what the next solve needs of a state; collective."""
    problem = state.problem
    saved = SavedState(
        displacement=problem.u.x.array.copy(),
        travels=state.system.tools.travels,
        multipliers=state.multipliers,
        penalty=problem.penalty,
        cones=state.report.last.cones if state.report.last else (),
    )
    after = tuple(
        fields.contact.state_after(problem.u, fields.state != OPEN, fields.holds)
        for fields in state.contacts
    )
    return State(saved, after)


def _facts(state: SolvedState) -> dict[str, Any]:
    """The numbers of summary.json, except those of the certificate and the caller; collective."""
    problem, report, target = state.problem, state.report, state.target
    domain, data, u = problem.domain, problem.data, problem.u
    return {
        "discretisation": data.element.facts(),
        "dofs": int(u.function_space.dofmap.index_map.size_global * domain.dim),
        "cells": domain.num_cells,
        "ranks": domain.comm.size,
        "dolfinx": dolfinx.__version__,
        **computed("body", state.body),
        **_contacts(state),
        "strain_sets": state.body.about_sets(),
        "iterations": {
            "tangents": report.tangents,
            "linear": report.linear,
            "friction": report.updates,
        },
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
    }


def _contacts(state: SolvedState) -> dict[str, Any]:
    """The entries of summary.json about all contacts together and about each; collective."""
    domain, tools = state.problem.domain, state.system.tools
    entries: list[dict[str, Any]] = []
    for fields in state.contacts:
        numbers = computed("contact", Contacts(domain, (fields,)))
        contact, against = fields.contact, fields.contact.against
        places = {"on": list(contact.on), **({"against": list(against)} if against else {})}
        entry = {"name": contact.concept.name, **places, **numbers}
        for tool, size in zip(tools, tools.travels, strict=True):
            if tool.contact is fields.contact:
                entry["tool"] = tool.summary(size)
        if contact.foundation.moves:
            entry["motion"] = contact.foundation.motion().translation.tolist()
        entries.append(entry)
    whole = computed("contact", Contacts(domain, state.contacts))
    if len(entries) > 1:
        alone = tuple(fields for fields in state.contacts if not fields.contact.against)
        sums = computed("contact", Contacts(domain, alone))
        resultants = [key for key, quantity in QUANTITIES.items() if quantity.is_resultant]
        whole |= {key: sums[key] if alone else None for key in resultants}
    return whole | {"contacts": entries}
