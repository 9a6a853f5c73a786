"""How displacement conditions, springs and contact hold every connected part of the body."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from dolfinx import fem

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.errors import InputError
from contact_locking.mesh.domain import Domain
from contact_locking.problem import forms
from contact_locking.problem.rigidity.group import GroupMotions
from contact_locking.problem.rigidity.loose_motion import LooseMotion
from contact_locking.problem.rigidity.motions import dofs_of, free_motions, rigid_motions
from contact_locking.problem.rigidity.programmes import sliding_motions
from contact_locking.problem.springs import Springs, motions_past
from contact_locking.supports.conditions import Constraints


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


class Rigidity:
    """The rigid motions of each part of the body; all methods are collective.

    Parts that touch each other may move together, and are judged together.
    """

    def __init__(
        self,
        domain: Domain,
        space: fem.FunctionSpace,
        data: forms.ProblemData,
        constraints: Constraints,
    ) -> None:
        self._domain, self._space = domain, space
        self._data, self._constraints = data, constraints

    def held(self, displacements: Sequence[str], supports: Sequence[str]) -> list[Held]:
        """How each part is held, whatever the loads.

        ``displacements`` and ``supports`` are the boundary parts that conditions hold.
        """
        domain, data, found = self._domain, self._data, {}
        touching = [part for contact in data.contacts for part in (*contact.on, *contact.against)]
        springs = [item.on for item in data.springs if isinstance(item, Springs)]
        for group, motions in self._groups():
            sliding = sliding_motions(motions.normals).shape[1]
            counts = [free.shape[1] for _, free in motions.parts]
            loosest = group[int(np.argmax(counts))]
            for number, free in zip(group, counts, strict=True):
                own = dofs_of(domain, self._space, number)
                conditions = free_motions(domain, self._space, self._constraints, own)
                found[number] = Held(
                    domain.part_names[number],
                    _touching(domain, number, displacements),
                    _touching(domain, number, touching),
                    _touching(domain, number, supports),
                    free,
                    # Bodies that touch each other may slide together: they count once.
                    sliding if number == loosest else 0,
                    _touching(domain, number, springs),
                    conditions.shape[1] - free,
                )
        return [found[number] for number in sorted(found)]

    def require_held(self) -> None:
        """Raise InputError for a part that is free to move under the present loads."""
        domain = self._domain
        for group, motions in self._groups():
            try:
                motions.require_tools_held()
                motions.require_held(motions.most_work)
            except InputError as error:
                if len(domain.part_names) == 1 or len(group) > 1:
                    raise
                shared = "edge" if domain.dim == 2 else "face"
                name = domain.part_names[group[0]]
                raise InputError(
                    f"{name} is loose, as it shares no {shared} with the rest: {error}", error.key
                ) from None

    def describe_slide(self) -> str | None:
        """A motion c that neither contact nor friction stops, in words, or None.

        Three searches, for each part of the body:

        - In equilibrium ``(f, c) = int p c_nu - sigma_tau . c_tau``.  Where mu does not depend on
          the slip and R has no negative entry, this is at most ``int p (c_nu + R* (mu |c_tau|))``
          for the pressure p >= 0.  So a motion with ``c_nu + R* (mu |c_tau|) <= 0`` at all nodes
          and ``(f, c) > 0`` proves that there is no equilibrium on this mesh, whatever the friction
          bound.
        - The resultants T along and N onto a flat foundation with ``T > mu N`` break Coulomb's law
          for the whole contact.  This proves nothing, as ``int R p`` is not ``int p``.
        - A motion that slides or lifts off, ``c_nu <= 0``, with ``(f, c) > int G |c_tau|`` proves
          for the present bound G alone that there is no equilibrium.
        """
        names = self._domain.part_names
        for group, found in self._groups():
            if not found.of_body:
                continue
            told = found.describe_unheld() or found.describe_push() or found.describe_slide()
            if told is not None:
                of = " and ".join(names[number] for number in group)
                return f"{of}: {told}" if len(names) > 1 else told
        return None

    def is_unheld(self) -> bool:
        """Whether the first search of :meth:`describe_slide` has found a motion, with its proof."""
        return any(
            found.of_body and found.describe_unheld() is not None for _, found in self._groups()
        )

    def describe_loose(self) -> str | None:
        """The rigid motion that present loads and forces of tools do not resist, in words, or None.

        Tools may press the body less than at other times.
        """
        for _, found in self._groups():
            try:
                found.require_held(found.work)
            except InputError as error:
                return str(error)
        return None

    def loose_motion(self) -> LooseMotion:
        """The motions that conditions leave free, as shares of displacements."""
        _, fields = self.loose()
        return LooseMotion(self._space, fields, self._constraints, self._data.contacts)

    def loose(self) -> tuple[list[FloatArray], FloatArray]:
        """The rigid motions of each part that conditions and springs leave free.

        For each part the coefficients (m, f) of its motions, and the values (g, n) of the motions
        of all parts at the local dofs, ghosts included.
        """
        found = [self._of_part(number) for number in range(len(self._domain.part_names))]
        return [free for free, _, _ in found], np.vstack([fields for _, fields, _ in found])

    def _of_part(self, number: int) -> tuple[FloatArray, FloatArray, BoolArray]:
        """The coefficients (m, f) of the free motions of a part, their values (f, n), its dofs."""
        domain, space = self._domain, self._space
        own = dofs_of(domain, space, number)
        free = free_motions(domain, space, self._constraints, own)
        fields = (free.T @ rigid_motions(space, domain.axisymmetric)) * own
        past = motions_past(self._data.springs, space, fields)
        return free @ past, past.T @ fields, own

    def _groups(self) -> Iterator[tuple[tuple[int, ...], GroupMotions]]:
        """The numbers of the parts that touch each other, and their motions."""
        domain, data = self._domain, self._data
        groups = [{number} for number in range(len(domain.part_names))]
        for contact in data.contacts:
            if contact.against:
                facets = domain.facets((*contact.on, *contact.against))
                here = domain.comm.allgather(np.unique(domain.parts[domain.owners(facets)]))
                joined = set(map(int, np.concatenate(here)))
                apart = [group for group in groups if not group & joined]
                groups = [*apart, set().union(*(group for group in groups if group & joined))]
        for group in sorted(tuple(sorted(group)) for group in groups):
            frees, fields, dofs = zip(*map(self._of_part, group), strict=True)
            names = [domain.part_names[number] for number in group]
            parts, marks = list(zip(names, frees, strict=True)), np.logical_or.reduce(dofs)
            yield group, GroupMotions(domain, self._space, data, parts, np.vstack(fields), marks)


def _touching(domain: Domain, part: int, names: Sequence[str]) -> tuple[str, ...]:
    """The named boundary parts that have facets of one part of the body; collective."""
    names = list(dict.fromkeys(names))
    there = [
        bool(np.any(domain.parts[domain.owners(domain.facets((name,)))] == part)) for name in names
    ]
    anywhere = np.any(domain.comm.allgather(there), axis=0)
    return tuple(name for name, here in zip(names, anywhere, strict=True) if here)
