"""Findings about a solved state, one function for each; all are collective."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from contact_locking.certificate.solved_state import SolvedState
from contact_locking.findings import Finding
from contact_locking.parallel import maximum
from contact_locking.plain_text import coordinates
from contact_locking.results.between_nodes import uncovered_entry
from contact_locking.results.contact_points import OPEN

# The theory neglects squares of the displacement gradient: a tenth of such a strain, and half of
# the square of a rotation.  Strains above 1 come from a mistake.
_LARGE_STRAIN, _LARGE_ROTATION, _ABSURD_STRAIN = 0.1, 0.1, 1.0
# An excess above this is printed as a multiple, and one below in per cent.
_MULTIPLE = 10.0
# The share of violation that is a finding, and the share that the advice aims at.
_NOTABLE, _AIM = 0.1, 0.01
# The excess over the limit that is accepted between the points where an element enforces it.
_BETWEEN = 0.05
# The compliance of the body at edges, where pressure concentrates, over length/E.
_CONCENTRATED = 0.2
# Nodes with this share of the largest pressure count as pressing.
_PRESSES = 0.01


def findings(state: SolvedState) -> list[Finding]:
    """Properties of a solved state that the user probably did not intend; collective."""
    return [finding for judge in _FINDINGS for finding in judge(state)]


def _large_strain(state: SolvedState) -> Iterator[Finding]:
    """Strains too large for the theory of small strains."""
    strain = state.body.largest(state.body.strain_norm)
    if strain > _ABSURD_STRAIN:
        yield Finding("strain.absurd", strain=strain)
    # The strain may be at a limit of this size, to the tolerance of the solver.
    elif strain > _LARGE_STRAIN * (1.0 + 1e-6):
        yield Finding("strain.large", strain=strain, per_cent=100.0 * strain)


def _large_rotation(state: SolvedState) -> Iterator[Finding]:
    """Rotations whose half square is not small beside the largest strain."""
    angle, place = state.body.peak(state.body.rotation)
    strain, neglected = state.body.largest(state.body.strain_norm), 0.5 * angle**2
    if place is not None and angle > _LARGE_ROTATION and neglected > _NOTABLE * strain:
        at = ", ".join(f"{x:.3g}" for x in place)
        yield Finding("rotation.large", angle=angle, place=at, neglected=neglected, strain=strain)


def _exceeded_limit(state: SolvedState) -> Iterator[Finding]:
    """A strain beyond its limit by ``|eps|/M - 1 = |Z|/(2 n M)`` (23), or between its points.

    The advised n assumes that the stiffer penalty bears the same Z or, if this is more, the present
    stress of the material.
    """
    body, target = state.body, state.target
    used = body.largest(body.strain_norm, body.locking_limit)
    excess, anywhere = used - 1.0, max(body.peaks[1], 1.0)
    advice: Any = {
        "n": max(target.penalty.n, 0.5 * target.young) * excess / _AIM,
        "aim": 100.0 * _AIM,
    }
    if excess >= _MULTIPLE:
        yield Finding("limit.exceeded_far", times=used, **advice)
    elif excess > _NOTABLE:
        yield Finding("limit.exceeded", per_cent=100.0 * excess, **advice)
    if anywhere - max(used, 1.0) > _BETWEEN:
        yield Finding("limit.between_points", per_cent=100.0 * anywhere)


def _held_nodes(state: SolvedState) -> Iterator[Finding]:
    """Foundations that enter the body at nodes that cannot give way."""
    for fields in state.contacts:
        depth = maximum(state.comm, (fields.u_normal - fields.gap)[~fields.free])
        if depth > _NOTABLE * state.largest_displacement:
            yield Finding("contact.held_nodes", fields.contact.key, depth=depth)


def _entry_between_nodes(state: SolvedState) -> Iterator[Finding]:
    """Foundations that enter between the nodes of Gamma_C by much of their indentation."""
    for fields in state.contacts:
        entry = fields.entry
        if entry.share > _NOTABLE:
            yield Finding(
                "contact.between_nodes",
                fields.contact.key,
                place=coordinates(entry.place),
                depth=entry.depth,
                per_cent=100.0 * entry.share,
            )


def _turning_normals(state: SolvedState) -> Iterator[Finding]:
    """Normals that turn by much of the friction coefficient, with ``pair: once``."""
    for fields in state.contacts:
        contact = fields.contact
        if contact.friction.frictionless or contact.pairs_anew:
            continue
        presses = fields.pressure > _PRESSES * maximum(state.comm, fields.pressure)
        turn = contact.turn(state.problem.u, presses)
        mu = contact.friction.coefficient(fields.slip)
        least = -maximum(state.comm, -mu[presses], -np.inf)
        if turn > _NOTABLE * least:
            yield Finding("contact.normals", contact.key, turn=turn, friction=least)


def _sliding_bodies(state: SolvedState) -> Iterator[Finding]:
    """Bodies that slide farther than the points that face each other allow."""
    for fields in state.contacts:
        contact, facet = fields.contact, fields.surface.facing_length
        slid = maximum(state.comm, contact.slid(state.problem.u)[fields.state != OPEN])
        if slid > facet:
            yield Finding("contact.sliding", contact.key, slid=slid, facets=slid / facet)


def _uncovered_boundary(state: SolvedState) -> Iterator[Finding]:
    """A boundary outside of Gamma_C that enters the foundation of a contact."""
    for contact in state.problem.contacts:
        depth, place = uncovered_entry(state.problem.domain, state.problem.u, contact)
        if depth > _NOTABLE * state.largest_displacement:
            yield Finding("contact.uncovered", contact.key, depth=depth, place=coordinates(place))


def _penetration(state: SolvedState) -> Iterator[Finding]:
    """A body that enters the foundation by ``max [u_nu - gap]^+ = eps p`` (25)."""
    target, epsilon = state.target, state.target.penalty.epsilon
    entered = [
        maximum(state.comm, (fields.u_normal - fields.gap)[fields.free])
        for fields in state.contacts
    ]
    depth = max(entered, default=0.0)
    if epsilon > 0.0 and depth > _NOTABLE * state.largest_displacement:
        share = depth / state.largest_displacement
        better = _AIM * min(epsilon / share, _CONCENTRATED * target.length / target.young)
        follows_n = state.problem.follows_n
        yield Finding(
            "contact.penetration",
            per_cent=100.0 * share,
            parameter="penalty.n" if follows_n else "penalty.epsilon",
            value=1.0 / better if follows_n else better,
            aim=100.0 * _AIM,
        )


_FINDINGS = (
    _large_strain,
    _large_rotation,
    _exceeded_limit,
    _held_nodes,
    _entry_between_nodes,
    _turning_normals,
    _sliding_bodies,
    _uncovered_boundary,
    _penetration,
)
