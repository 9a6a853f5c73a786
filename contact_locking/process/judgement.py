"""The solution of a solved state, with its summary."""

from __future__ import annotations

from typing import Any

import dolfinx
import numpy as np
from dolfinx import fem

from contact_locking.certificate.laws import ENTRY
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.certificate.verdict import Certificate
from contact_locking.fields import plausibility
from contact_locking.parallel import maximum
from contact_locking.results.between_nodes import uncovered_entry
from contact_locking.results.body_fields import BodyFields
from contact_locking.results.contact_points import OPEN
from contact_locking.results.derived import ContactFields, Contacts, gather_contacts, on_gamma_c
from contact_locking.results.quantities import QUANTITIES, computed
from contact_locking.results.solution import Differentiable, Solution, State
from contact_locking.solver.task import SavedState

_WAY_OUT_OF_SLIDING = (
    "Press the body more, raise friction.coefficient, or hold it by loads.displacements."
)
_WAY_OUT_OF_ENTRY = (
    "Refine the mesh where the foundation enters: mesh.h_contact or mesh.h; or take a rounder "
    "foundation."
)
_WAY_OUT_OF_COMPLAINTS = (
    "Raise solver.tolerance, or lower penalty.n: rounding in the strain is multiplied by 2 n."
)


def solution_of(
    state: SolvedState,
    certificate: Certificate | None,
    differentiable: Differentiable | None = None,
) -> Solution:
    """The fields, the contact points and the summary of a solved state; collective.

    Without a certificate the summary repeats the verdict of the solver.
    """
    problem, body = state.problem, state.body
    indicator = certificate.indicator if certificate else None
    points, facets = gather_contacts(state.contacts, problem.domain)
    # The next solve overwrites the displacement of the problem.
    own = problem.u.copy()
    own.name = problem.u.name
    return Solution(
        domain=problem.domain,
        element=problem.element,
        displacement=own,
        **{name: getattr(body, name) for name in BodyFields.FIELDS},
        error_indicator=indicator and indicator.field,
        elastic_error_indicator=indicator and indicator.elastic_field,
        contacts=state.contacts,
        contact_points=points,
        contact_facets=facets,
        summary=_summary(state, certificate),
        differentiable=differentiable,
        data=problem.data,
        state=state_of(state),
        **on_gamma_c(state.contacts, problem.u),
    )


def state_of(state: SolvedState) -> State:
    """The state as a value; collective."""
    problem = state.problem
    saved = SavedState(
        displacement=problem.u.x.array.copy(),
        travels=state.system.tools.travels,
        multipliers=state.multipliers,
        penalty=problem.penalty,
        last=state.report.last,
    )
    after = tuple(
        fields.contact.state_after(problem.u, fields.state != OPEN, fields.holds)
        for fields in state.contacts
    )
    return State(saved, state.multipliers, after)


def _warnings(state: SolvedState, numbers: dict[str, Any]) -> list[str]:
    """Warnings about results that the user probably did not intend; collective."""
    problem, target, data, body = state.problem, state.target, state.problem.data, state.body
    depths = [(fields.u_normal - fields.gap, fields.free) for fields in state.contacts]
    entering = [maximum(state.comm, depth[free]) for depth, free in depths]
    held = [maximum(state.comm, depth[~free]) for depth, free in depths]
    largest = numbers["strain_norm_max"]
    found = plausibility.about_the_strain(largest)
    found += plausibility.about_the_rotation(
        numbers["rotation_max"], numbers["rotation_max_at"], largest
    )
    used = body.largest(body.strain_norm, body.locking_limit)
    found += plausibility.about_the_overstrain(used - 1.0, target.penalty.n, target.young)
    found += plausibility.about_strains_between_points(used, numbers["overstrain_max"] + 1.0)
    found += plausibility.about_held_nodes(
        [fields.contact.key for fields in state.contacts], held, state.largest_displacement
    )
    for fields in state.contacts:
        between = fields.entry
        found += plausibility.about_an_entry(
            fields.contact.key, between.depth, between.share, between.place
        )
        found += _about_the_normals(fields, problem.u)
        length = fields.surface.facing_length
        slid = fields.contact.slid(problem.u)[fields.state != OPEN]
        found += plausibility.about_the_sliding(
            fields.contact.key, maximum(state.comm, slid), length
        )
    for contact in data.contacts:
        depth, place = uncovered_entry(problem.domain, problem.u, contact)
        found += plausibility.about_uncovered_boundary(
            contact.key, depth, place, state.largest_displacement
        )
    return found + plausibility.about_the_penetration(
        max(entering, default=0.0),
        state.largest_displacement,
        target.penalty.epsilon,
        target.length / target.young,
        follows_n=problem.follows_n,
    )


def _about_the_normals(fields: ContactFields, u: fem.Function) -> list[str]:
    """A warning about bodies in the undeformed frame whose normals turn; collective."""
    contact = fields.contact
    if contact.friction.frictionless or contact.pairs_anew:
        return []
    comm = contact.surface.domain.comm
    pressed = fields.pressure > 0.01 * maximum(comm, fields.pressure)
    turn = contact.turn(u, pressed)
    mu = contact.friction.coefficient(fields.slip)
    return plausibility.about_the_normals(contact.key, turn, -maximum(comm, -mu[pressed], -np.inf))


def _summary(state: SolvedState, certificate: Certificate | None) -> dict[str, Any]:
    """summary.json, without the entries that only the caller knows; collective."""
    problem, report, target = state.problem, state.report, state.target
    domain, data, u = problem.domain, problem.data, problem.u
    slide = None
    if problem.free and not report.converged:
        slide = problem.rigidity.describe_slide()
        if slide is None and data.tools:
            slide = problem.rigidity.describe_loose()
    numbers = computed("body", state.body) | _contacts(state)
    warnings = [*problem.warnings, *report.warnings]
    if report.converged:
        warnings += _warnings(state, numbers)
    summary: dict[str, Any] = {
        "converged": report.converged,
        "reason": f"{slide}; {report.reason}" if slide else report.reason,
        "suggestion": _WAY_OUT_OF_SLIDING if slide else report.suggestion,
        "discretisation": data.element.facts(),
        "dofs": int(u.function_space.dofmap.index_map.size_global * domain.dim),
        "cells": domain.num_cells,
        "ranks": domain.comm.size,
        "dolfinx": dolfinx.__version__,
        **numbers,
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
        "warnings": warnings,
    }
    return summary if certificate is None else _judged(summary, state, certificate)


def _contacts(state: SolvedState) -> dict[str, Any]:
    """The keys of summary.json about all contacts together, and about each contact; collective."""
    domain, tools = state.problem.domain, state.system.tools
    entries: list[dict[str, Any]] = []
    for fields in state.contacts:
        found = computed("contact", Contacts(domain, (fields,)))
        contact, against = fields.contact, fields.contact.against
        places = {"on": list(contact.on), **({"against": list(against)} if against else {})}
        entry = {"name": contact.given.name, **places, **found}
        for tool, size in zip(tools, tools.travels, strict=True):
            if tool.contact is fields.contact:
                entry["tool"] = tool.summary(size)
        if contact.foundation.moves:
            entry["motion"] = contact.foundation.motion().translation.tolist()
        entries.append(entry)
    whole = computed("contact", Contacts(domain, state.contacts))
    if len(entries) > 1:
        alone = tuple(item for item in state.contacts if not item.contact.against)
        sums = computed("contact", Contacts(domain, alone))
        resultants = [key for key, item in QUANTITIES.items() if item.is_resultant]
        whole |= {key: sums[key] if alone else None for key in resultants}
    return whole | {"contacts": entries}


def _judged(
    summary: dict[str, Any], state: SolvedState, certificate: Certificate
) -> dict[str, Any]:
    """The summary with the results of the certificate."""
    report, proofs = state.report, certificate.proofs
    summary |= {
        "reactions": certificate.reactions,
        "residual": certificate.residual,
        "certificate": certificate.summary(),
        "warnings": [*summary["warnings"], *proofs.warnings],
    }
    if "bounds" in proofs.entries:
        summary["bounds"] = proofs.entries["bounds"]
    if not report.converged and proofs.reason:
        summary["reason"] += f"; {proofs.reason}"
    if report.converged and certificate.complaint:
        enters = bool(state.contacts) and not certificate.criteria[ENTRY].holds
        way_out = _WAY_OUT_OF_ENTRY if enters else _WAY_OUT_OF_COMPLAINTS
        summary |= {"converged": False, "reason": certificate.complaint, "suggestion": way_out}
    return summary
