"""The check that displacement conditions and contact hold every connected part of the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError
from contact_locking.mesh.domain import Domain
from contact_locking.problem import forms
from contact_locking.problem.motions import Motions, dofs_of, motions_of_part
from contact_locking.problem.springs import Springs
from contact_locking.supports.conditions import Constraints
from contact_locking.supports.rigid_motions import (
    free_motions,
    sliding_motions,
)


@dataclass(frozen=True)
class Held:
    """A part of the body, the boundary parts that hold the part, and its free rigid motions.

    ``free`` is the number of rigid motions that displacement conditions and springs leave free, and
    ``sliding`` is the number of these motions that friction alone can stop.  ``sprung`` is the
    number of motions that springs stop and no displacement condition does.
    """

    name: str
    displacements: tuple[str, ...]
    contact: tuple[str, ...]
    supports: tuple[str, ...]
    free: int
    sliding: int
    springs: tuple[str, ...] = ()
    sprung: int = 0

    def __str__(self) -> str:
        words = []
        if self.displacements:
            words.append(f"displacements on {', '.join(self.displacements)}")
        if self.supports:
            words.append(f"supports on {', '.join(self.supports)}")
        if self.springs:
            words.append(f"springs on {', '.join(self.springs)}")
        if self.contact and self.free:
            friction = " and friction" if self.sliding else ""
            words.append(f"contact{friction} on {', '.join(self.contact)}")
        return " and ".join(words)


def parts_held(
    domain: Domain,
    space: fem.FunctionSpace,
    data: forms.ProblemData,
    constraints: Constraints,
    displacements: Sequence[str],
    supports: Sequence[str],
) -> list[Held]:
    """How each part is held, whatever the loads; collective.

    ``displacements`` and ``supports`` are the boundary parts that conditions hold.
    """
    found = {}
    touching = [part for contact in data.contacts for part in (*contact.on, *contact.against)]
    springs = dict.fromkeys(item.on for item in data.springs if isinstance(item, Springs))
    for group in _groups(domain, data):
        motions = Motions(domain, space, data, constraints, group)
        sliding = sliding_motions(motions.normals).shape[1]
        loosest = max(zip(motions.parts, group, strict=True), key=lambda it: it[0][1].shape[1])[1]
        for number, (_, free) in zip(group, motions.parts, strict=True):
            found[number] = Held(
                domain.part_names[number],
                _touching(domain, number, list(dict.fromkeys(displacements))),
                _touching(domain, number, list(dict.fromkeys(touching))),
                _touching(domain, number, list(dict.fromkeys(supports))),
                free.shape[1],
                # Bodies that touch each other may slide together: they count once.
                sliding if number == loosest else 0,
                _touching(domain, number, list(springs)),
                free_motions(domain, space, constraints, dofs_of(domain, space, number)).shape[1]
                - free.shape[1],
            )
    return [found[number] for number in sorted(found)]


def _groups(domain: Domain, data: forms.ProblemData) -> list[tuple[int, ...]]:
    """The numbers of the parts of the body, those together that touch each other; collective."""
    groups = [{number} for number in range(len(domain.part_names))]
    for contact in data.contacts:
        if contact.against:
            facets = domain.facets((*contact.on, *contact.against))
            here = domain.comm.allgather(np.unique(domain.parts[domain.owners(facets)]))
            joined = set(map(int, np.concatenate(here)))
            apart = [group for group in groups if not group & joined]
            groups = [*apart, set().union(*(group for group in groups if group & joined))]
    return sorted(tuple(sorted(group)) for group in groups)


def require_parts_held(
    domain: Domain, space: fem.FunctionSpace, data: forms.ProblemData, constraints: Constraints
) -> None:
    """Raise InputError for a part that is free to move under the present loads; collective."""
    several = len(domain.part_names) > 1
    for group in _groups(domain, data):
        motions = Motions(domain, space, data, constraints, group)
        try:
            motions.require_tools_held()
            motions.require_held(motions.most_work)
        except InputError as error:
            if not several:
                raise
            if len(group) > 1:
                raise
            shared = "edge" if domain.dim == 2 else "face"
            name = domain.part_names[group[0]]
            raise InputError(
                f"{name} is loose, as it shares no {shared} with the rest: {error}", error.key
            ) from None


def describe_slide(
    domain: Domain, space: fem.FunctionSpace, data: forms.ProblemData, constraints: Constraints
) -> str | None:
    """A motion c that neither contact nor friction stops, in words, or None; collective.

    Three searches, for each part of the body:

    - In equilibrium ``(f, c) = int p c_nu - sigma_tau . c_tau``.  Where mu does not depend on the
      slip and R has no negative entry, this is at most ``int p (c_nu + R* (mu |c_tau|))`` for the
      pressure p >= 0.  So a motion with ``c_nu + R* (mu |c_tau|) <= 0`` at all nodes and
      ``(f, c) > 0`` proves that there is no equilibrium on this mesh, whatever the friction bound.
    - The resultants T along and N onto a flat foundation with ``T > mu N`` break Coulomb's law for
      the whole contact.  This proves nothing, as ``int R p`` is not ``int p``.
    - A motion that slides or lifts off, ``c_nu <= 0``, with ``(f, c) > int G |c_tau|`` proves for
      the present bound G alone that there is no equilibrium.
    """
    for group in _groups(domain, data):
        found = Motions(domain, space, data, constraints, group)
        if not found.of_body:
            continue
        told = found.describe_unheld() or found.describe_push() or found.describe_slide()
        if told is not None:
            names = " and ".join(domain.part_names[number] for number in group)
            return f"{names}: {told}" if len(domain.part_names) > 1 else told
    return None


def describe_unheld(
    domain: Domain, space: fem.FunctionSpace, data: forms.ProblemData, constraints: Constraints
) -> str | None:
    """The first of the motions of :func:`describe_slide`, with its proof, or None; collective."""
    for group in _groups(domain, data):
        found = Motions(domain, space, data, constraints, group)
        if found.of_body and (told := found.describe_unheld()) is not None:
            return told
    return None


def describe_loose(
    domain: Domain, space: fem.FunctionSpace, data: forms.ProblemData, constraints: Constraints
) -> str | None:
    """The rigid motion that present loads and forces of tools do not resist, in words, or None.

    Tools may press the body less than at other times.  Collective.
    """
    for group in _groups(domain, data):
        found = Motions(domain, space, data, constraints, group)
        try:
            found.require_held(found.work)
        except InputError as error:
            return str(error)
    return None


def loose_fields(
    domain: Domain, space: fem.FunctionSpace, data: forms.ProblemData, constraints: Constraints
) -> FloatArray:
    """The rigid motions of each part that conditions and springs leave free; collective.

    The values (f, n) are those at the local dofs, ghosts included.
    """
    return np.vstack([values for _, values in loose_by_part(domain, space, data, constraints)])


def loose_by_part(
    domain: Domain, space: fem.FunctionSpace, data: forms.ProblemData, constraints: Constraints
) -> list[tuple[FloatArray, FloatArray]]:
    """For each part the coefficients (m, f) of its free motions, and their values; collective."""
    return [
        motions_of_part(domain, space, data, constraints, dofs_of(domain, space, number))
        for number in range(len(domain.part_names))
    ]


def _touching(domain: Domain, part: int, names: Sequence[str]) -> tuple[str, ...]:
    """The named boundary parts that have facets of one part of the body; collective."""
    there = [
        bool(np.any(domain.parts[domain.owners(domain.facets((name,)))] == part)) for name in names
    ]
    anywhere = np.any(domain.comm.allgather(there), axis=0)
    return tuple(name for name, here in zip(names, anywhere, strict=True) if here)
