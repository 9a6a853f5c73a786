"""The check that displacement conditions and contact hold every connected part of the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem, la

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.errors import InputError
from contact_locking.parameters import LoadParameters
from contact_locking.problem import compiled, forms
from contact_locking.problem.conditions import Constraints
from contact_locking.problem.contact import Contact
from contact_locking.problem.domain import Domain
from contact_locking.problem.rigid_motions import (
    check_held,
    describe_motion,
    free_motions,
    rigid_motions,
    sliding_motions,
)


@dataclass(frozen=True)
class Held:
    """A part of the body, the boundary parts that hold the part, and its free rigid motions.

    ``free`` is the number of rigid motions that the displacement conditions leave free, and
    ``sliding`` is the number of these motions that friction alone can stop.
    """

    name: str
    displacements: tuple[str, ...]
    contact: tuple[str, ...]
    supports: tuple[str, ...]
    free: int
    sliding: int

    def __str__(self) -> str:
        words = []
        if self.displacements:
            words.append(f"displacements on {', '.join(self.displacements)}")
        if self.supports:
            words.append(f"supports on {', '.join(self.supports)}")
        if self.contact and self.free:
            friction = " and friction" if self.sliding else ""
            words.append(f"contact{friction} on {', '.join(self.contact)}")
        return " and ".join(words)


def check_parts_held(
    domain: Domain,
    space: fem.FunctionSpace,
    data: forms.ProblemData,
    constraints: Constraints,
    loads: LoadParameters,
) -> list[Held]:
    """How each part is held; raises InputError for a part that is free to move; collective."""
    several = len(domain.part_names) > 1
    found = []
    for number, name in enumerate(domain.part_names):
        motions = _Motions(domain, space, data, constraints, number)
        try:
            check_held(motions.free, motions.normals, motions.rubs, motions.work, domain.dim)
        except InputError as error:
            if not several:
                raise
            shared = "edge" if domain.dim == 2 else "face"
            raise InputError(
                f"{name} is loose, as it shares no {shared} with the rest: {error}", error.key
            ) from None
        supports = [part for item in loads.supports for part in item.on]
        on = [part for item in loads.displacements for part in item.on]
        touching = [part for contact in data.contacts for part in contact.on]
        found.append(
            Held(
                name,
                _touching(domain, number, list(dict.fromkeys(on))),
                _touching(domain, number, list(dict.fromkeys(touching))),
                _touching(domain, number, list(dict.fromkeys(supports))),
                int(motions.free.shape[1]),
                sliding_motions(motions.normals).shape[1],
            )
        )
    return found


def describe_slide(
    domain: Domain, space: fem.FunctionSpace, data: forms.ProblemData, constraints: Constraints
) -> str | None:
    """A sliding motion c with ``(f, c) > int G |c_tau|``, in words; None if there is none.

    The loads do more work along c than friction with the present bound G can dissipate.  Of each
    part of the body only the sliding motion with the most work of the loads is checked.
    Collective.
    """
    for number in range(len(domain.part_names)):
        found = _Motions(domain, space, data, constraints, number)
        slides = sliding_motions(found.normals)
        push = slides @ (slides.T @ found.work)
        if not np.any(push):
            continue
        taken = domain.comm.allreduce(sum(item.taken(push) for item in found.at_contacts))
        if float(push @ found.work) > taken:
            motion = describe_motion(found.free @ push, domain.dim)
            return f"friction cannot hold the body, which is free to move (rigid motion: {motion})"
    return None


class _Motions:
    """The f rigid motions of a part that the displacement conditions leave free.

    ``free`` (m, f) are the coefficients of the motions, and ``work`` (f,) is the work of the loads
    along the motions.  ``normals`` (n, f) are their normal components at all nodes of Gamma_C on
    the part, and ``rubs`` (n,) marks the nodes with friction.  The constructor is collective.
    """

    def __init__(
        self,
        domain: Domain,
        space: fem.FunctionSpace,
        data: forms.ProblemData,
        constraints: Constraints,
        number: int,
    ) -> None:
        part = _dofs(domain, space, number)
        self.free = free_motions(domain, space, constraints, part)
        motions = (self.free.T @ rigid_motions(space, domain.axisymmetric)) * part
        self.work = np.zeros(len(motions))
        self.at_contacts: list[_AtContact] = []
        self.normals: FloatArray = np.zeros((0, len(motions)))
        self.rubs: BoolArray = np.zeros(0, dtype=bool)
        if not len(motions):
            return
        work_form = compiled.form(forms.external_work(ufl.TestFunction(space), data))
        self.work = domain.comm.allreduce(motions @ fem.assemble_vector(work_form).array)
        self.at_contacts = [_AtContact(contact, motions, part) for contact in data.contacts]
        for item in self.at_contacts:
            normals = np.concatenate(domain.comm.allgather(item.normals))
            self.normals = np.vstack([self.normals, normals])
            rubs = np.full(len(normals), not item.contact.friction.frictionless)
            self.rubs = np.append(self.rubs, rubs)


class _AtContact:
    """Rigid motions at the owned nodes of one contact on one part of the body."""

    def __init__(self, contact: Contact, motions: FloatArray, part: BoolArray) -> None:
        self.contact, self._own = contact, contact.surface.is_of(part)
        blocks = contact.surface.blocks[self._own]
        self._motions = motions.reshape(len(motions), -1, contact.surface.domain.dim)[:, blocks]
        #: The normal components (k, f).
        self.normals = np.einsum("fkd,kd->kf", self._motions, contact.normals[self._own])

    def taken(self, motion: FloatArray) -> float:
        """``int G |c|``: the largest work of friction along a sliding motion c (f,), local."""
        slip = np.linalg.norm(np.einsum("fkd,f->kd", self._motions, motion), axis=1)
        weights, bound = self.contact.surface.weights[self._own], self.contact.bounds[self._own]
        return float(weights @ (bound * slip))


def _dofs(domain: Domain, space: fem.FunctionSpace, part: int) -> BoolArray:
    """The local dofs of a part's cells, ghosts included; collective."""
    dofmap = space.dofmap
    marks = la.vector(dofmap.index_map)
    marks.array[:] = 0.0
    marks.array[np.unique(dofmap.list[np.flatnonzero(domain.parts == part)])] = 1.0
    # A rank may have a node of the part without a cell of the part.
    marks.scatter_reverse(la.InsertMode.add)
    marks.scatter_forward()
    return np.repeat(marks.array > 0.0, dofmap.index_map_bs)


def _touching(domain: Domain, part: int, names: Sequence[str]) -> tuple[str, ...]:
    """The named boundary parts that have facets of one part of the body; collective."""
    there = [
        bool(np.any(domain.parts[domain.owners(domain.facets((name,)))] == part)) for name in names
    ]
    anywhere = np.any(domain.comm.allgather(there), axis=0)
    return tuple(name for name, here in zip(names, anywhere, strict=True) if here)
