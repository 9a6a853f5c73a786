"""The check that displacement conditions and contact hold every connected part of the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem, la

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.errors import InputError
from contact_locking.parallel import on_every_rank
from contact_locking.parameters import LoadParameters
from contact_locking.problem import compiled, forms
from contact_locking.problem.conditions import Constraints
from contact_locking.problem.domain import Domain
from contact_locking.problem.motions_at_contact import MotionsAtContact
from contact_locking.problem.pushed_tool import PushedTool
from contact_locking.problem.rigid_motions import (
    check_held,
    describe_motion,
    free_motions,
    rigid_motions,
    sliding_motions,
    unheld_motion,
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
            motions.require_tools_held()
            check_held(motions.free, motions.normals, motions.rubs, motions.most_work, domain.dim)
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
                motions.of_body,
                sliding_motions(motions.normals).shape[1],
            )
        )
    return found


def describe_slide(
    domain: Domain, space: fem.FunctionSpace, data: forms.ProblemData, constraints: Constraints
) -> str | None:
    """A motion c with ``(f, c) > int G |c_tau|`` that friction does not stop, in words, or None.

    Of each part of the body the sliding motion with the most work of the loads is checked with the
    present bound G.  With a coefficient mu that does not depend on the slip there may be a proof
    for any pressure p >= 0: in equilibrium ``(f, c) = int p c_nu - sigma_tau . c_tau`` is at most
    ``int p (c_nu + R* (mu |c_tau|))``, so that no motion with ``c_nu + R* (mu |c_tau|) <= 0`` at
    all nodes has ``(f, c) > 0``.  Collective.
    """
    for number in range(len(domain.part_names)):
        found = _Motions(domain, space, data, constraints, number)
        if not found.of_body:
            continue
        slides = sliding_motions(found.normals)
        push = slides @ (slides.T @ found.work)
        taken = domain.comm.allreduce(sum(item.taken(push) for item in found.at_contacts))
        moves: FloatArray | None = push
        if not float(push @ found.work) > taken:
            moves = found.unheld()
        if moves is not None:
            motion = describe_motion(found.free @ moves, domain.dim)
            what = "friction" if found.rubs.any() else "contact"
            return f"{what} cannot hold the body, which is free to move (rigid motion: {motion})"
    return None


def describe_loose(
    domain: Domain, space: fem.FunctionSpace, data: forms.ProblemData, constraints: Constraints
) -> str | None:
    """The rigid motion that present loads and forces of tools do not resist, in words, or None.

    Tools may press the body less than at other times.  Collective.
    """
    for number in range(len(domain.part_names)):
        found = _Motions(domain, space, data, constraints, number)
        try:
            check_held(found.free, found.normals, found.rubs, found.work, domain.dim)
        except InputError as error:
            return str(error)
    return None


def loose_fields(domain: Domain, space: fem.FunctionSpace, constraints: Constraints) -> FloatArray:
    """The rigid motions of each part that the displacement conditions leave free; collective.

    The values (f, n) are those at the local dofs, ghosts included.
    """
    found = [
        _loose_fields(domain, space, constraints, _dofs(domain, space, number))[1]
        for number in range(len(domain.part_names))
    ]
    return np.vstack(found)


def _loose_fields(
    domain: Domain, space: fem.FunctionSpace, constraints: Constraints, part: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """The coefficients (m, f) of the free motions of a part, and their values (f, n)."""
    free = free_motions(domain, space, constraints, part)
    return free, (free.T @ rigid_motions(space, domain.axisymmetric)) * part


class _Motions:
    """The f rigid motions of a part and its tools that the displacement conditions leave free.

    The first motions, ``of_body`` of them, move the part, and each of the others moves one tool
    that presses on this part alone along its force.  ``free`` (m, f) are the coefficients of the
    motions of the part, zero for a tool, and ``work`` (f,) is the work of the loads and of the
    present forces of tools along the motions; ``most_work`` is this with the largest forces of the
    process.  ``normals`` (n, f) are the normal components at all nodes of Gamma_C on the part,
    relative to tools, and ``rubs`` (n,) marks the nodes with friction.  The constructor is
    collective.
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
        free, motions = _loose_fields(domain, space, constraints, part)
        self._domain, self.of_body = domain, len(motions)
        self._tools = [tool for tool in data.tools if _is_at(tool, part)]
        self.free = np.pad(free, ((0, 0), (0, len(self._tools))))
        count = self.free.shape[1]
        self.work: FloatArray = np.zeros(count)
        self.at_contacts: list[MotionsAtContact] = []
        self.normals: FloatArray = np.zeros((0, count))
        self.rubs: BoolArray = np.zeros(0, dtype=bool)
        self.most_work = self.work
        if not count:
            return
        of_loads: FloatArray = np.zeros(0)
        if self.of_body:
            work_form = compiled.form(forms.external_work(ufl.TestFunction(space), data))
            of_loads = domain.comm.allreduce(motions @ fem.assemble_vector(work_form).array)
        self.work = np.array([*of_loads, *(tool.force for tool in self._tools)])
        self.most_work = np.array([*of_loads, *(tool.largest for tool in self._tools)])
        self.at_contacts = [
            MotionsAtContact(contact, motions, part, self._tools) for contact in data.contacts
        ]
        for item in self.at_contacts:
            normals = np.concatenate(domain.comm.allgather(item.normals))
            self.normals = np.vstack([self.normals, normals])
            rubs = np.full(len(normals), not item.contact.friction.frictionless)
            self.rubs = np.append(self.rubs, rubs)

    def unheld(self) -> FloatArray | None:
        """A motion (f,) that friction stops with no pressure at all, if one is found; collective.

        The coefficients of all contacts have to be known.
        """
        comm = self._domain.comm
        if not all(item.knows_friction() for item in self.at_contacts):
            return None

        def resistance(motion: FloatArray) -> FloatArray:
            rows = [item.resistance(motion) for item in self.at_contacts]
            return np.vstack([part for own in rows for part in comm.allgather(own)])

        return unheld_motion(self.normals, resistance, self.work)

    def require_tools_held(self) -> None:
        """Raise InputError if the part can move with its tools as one rigid body; collective."""
        if not self._tools or not self.of_body:
            return
        local = np.sum([item.gram() for item in self.at_contacts], axis=0)
        gram = self._domain.comm.allreduce(local)
        sizes = np.diag(gram)
        scale = 1.0 / np.sqrt(np.where(sizes > 0.0, sizes, 1.0))
        values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
        for motion in vectors[:, values <= 1e-12].T:
            if np.any(np.abs(motion[self.of_body :]) > 1e-6):
                words = describe_motion(self.free @ (scale * motion), self._domain.dim)
                raise InputError(
                    f"body and tools can move together as one rigid body ({words}): the forces "
                    "tell how hard the tools press, and nothing tells where; fix a component on a "
                    "boundary part in loads.displacements, or leave out one foundation.force",
                    self._tools[0].key,
                )


def _is_at(tool: PushedTool, part: BoolArray) -> bool:
    """Whether all nodes of a tool's contact are on one part of the body; collective."""
    return on_every_rank(tool.contact.surface.domain.comm, tool.contact.surface.is_of(part))


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
