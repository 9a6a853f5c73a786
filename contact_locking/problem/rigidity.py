"""How displacement conditions, springs and contact hold every connected part of the body."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem, la

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.errors import InputError
from contact_locking.fem.compiled import JointForm
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import maximum, on_every_rank
from contact_locking.problem import forms
from contact_locking.problem.loads import Springs, motions_past
from contact_locking.problem.motions import (
    MotionsAtContact,
    describe_motion,
    dofs_of,
    driven_motion,
    free_motions,
    loose_motion,
    null_motions,
    rigid_motions,
    sliding_motions,
    spin,
    unheld_motion,
)
from contact_locking.supports.conditions import Constraints
from contact_locking.supports.support import Displacement, Support

# Work below this share of all work and all motion is rounding.
_DIGITS = 1e-12
_ROUNDING = 1e-6
# The least friction coefficient in the linear programmes.
_LEAST_MU = 1e-9
# The margin for a friction bound that a solver reached without converging.
_REACHED = 1e-3


class GroupMotions:
    """The f rigid motions of touching parts, and of tools that press on them alone.

    - ``parts``: the name of each part with the coefficients (m, .) of its free motions
    - ``fields``, ``marks``: (g, n) the motions at the local dofs, and (n,) the dofs of the parts
    - ``free``: (m, f) the coefficients of all motions of parts, followed by zeros for each tool
    - ``normals``: (n, f) the normal components at all nodes of Gamma_C, relative to tools
    - ``rubs``: (n,) marks the nodes with friction

    The constructor is collective.
    """

    def __init__(
        self,
        domain: Domain,
        space: fem.FunctionSpace,
        data: forms.ProblemData,
        parts: Sequence[tuple[str, FloatArray]],
        fields: FloatArray,
        marks: BoolArray,
    ) -> None:
        self._domain, self._space, self._data = domain, space, data
        self.parts, self._of_body, self.of_body = parts, fields, len(fields)
        self._tools = [
            tool
            for tool in data.loose_tools
            if on_every_rank(domain.comm, tool.contact.surface.is_of(marks))
        ]
        free = np.hstack([at for _, at in parts])
        self.free = np.pad(free, ((0, 0), (0, len(self._tools))))
        count = self.free.shape[1]
        self.at_contacts = [
            MotionsAtContact(contact, fields, marks, self._tools)
            for contact in (data.contacts if count else ())
        ]
        of_contacts = [np.concatenate(domain.comm.allgather(at.normals)) for at in self.at_contacts]
        self.normals = np.vstack([np.zeros((0, count)), *of_contacts])
        rubs = [not at.contact.friction.frictionless for at in self.at_contacts]
        self.rubs = np.repeat(np.array(rubs, dtype=bool), [len(rows) for rows in of_contacts])

    @property
    def work(self) -> FloatArray:
        """The work (f,) of the loads and of the present forces of tools along the motions."""
        return np.array([*self._of_loads, *(tool.force for tool in self._tools)])

    @property
    def most_work(self) -> FloatArray:
        """:attr:`work` with the largest forces of tools in the process."""
        return np.array([*self._of_loads, *(tool.largest for tool in self._tools)])

    @functools.cached_property
    def _of_loads(self) -> FloatArray:
        """The work of the loads along the motions of the part; collective."""
        if not self.of_body:
            return np.zeros(0)
        dofmap = self._space.dofmap
        loads = la.vector(dofmap.index_map, dofmap.index_map_bs)
        work = JointForm(forms.external_work(ufl.TestFunction(self._space), self._data))
        work.assemble_vector(loads)
        owned = dofmap.index_map.size_local * dofmap.index_map_bs
        local = self._of_body[:, :owned] @ loads.array[:owned]
        return np.asarray(self._domain.comm.allreduce(local))

    def require_held(self, work: FloatArray) -> None:
        """Raise InputError if the part can move rigidly without resistance; collective.

        ``work`` (f,) is the work of the loads along the motions.
        """
        if not self.of_body:
            return
        comm = self._domain.comm
        triangles = [
            np.linalg.qr(rows, mode="r")
            for at in self.at_contacts
            for rows in comm.allgather(at.tangents())
        ]
        tangents = np.vstack([np.zeros((0, len(work))), *triangles])
        motion = loose_motion(self.normals, tangents, self.rubs, work)
        if motion is None:
            return
        if not len(self.normals):
            why = "nothing holds the body"
        elif np.abs(self.normals @ motion).max() < 1e-6 * np.abs(self.normals).max():
            why = "it slides along the foundation"
        else:
            why = "the loads do not press the body onto the foundation"
        raise InputError(
            "the displacement conditions leave a rigid motion free "
            f"({self._words(motion)}): {why}; fix a boundary part, or a component of it, in "
            "loads.displacements, or a direction in loads.supports",
            "loads.displacements",
        )

    def describe_unheld(self) -> str | None:
        """A motion that neither pressure nor friction can stop, with its proof in words.

        None without one, or if the friction of a contact is unknown before a solve.  Collective.
        """
        comm = self._domain.comm
        if not all([at.knows_friction() for at in self.at_contacts]):
            return None

        def resistance(motion: FloatArray) -> FloatArray:
            rows = [at.resistance(motion) for at in self.at_contacts]
            return np.vstack([of_rank for local in rows for of_rank in comm.allgather(local)])

        motion = unheld_motion(self.normals, resistance, self.work)
        if motion is None:
            return None
        what = "friction" if self.rubs.any() else "contact"
        words = f"it is free to move (rigid motion: {self._words(motion)})"
        mu = []
        for at in self.at_contacts:
            without_slip = at.contact.friction.coefficient(np.zeros(len(at.owned)))
            mu.append(maximum(comm, without_slip[at.owned]))
        proof = "proved on this mesh"
        if any(0.0 < value < _LEAST_MU for value in mu):
            proof += f", coefficients below {_LEAST_MU:g} counted as zero"
        return f"{what} cannot hold the body, whatever the pressure ({proof}): {words}"

    def describe_slide(self) -> str | None:
        """A motion that the present friction bound allows, in words; collective.

        It slides along the foundation, or else may leave it, too.
        """
        return self._unstopped(sliding_motions(self.normals), self.normals[:0]) or self._unstopped(
            np.eye(len(self.work)), self.normals
        )

    def _unstopped(self, some: FloatArray, normals: FloatArray) -> str | None:
        """One of the motions ``some`` (f, m) with ``normals c <= 0``; collective."""
        if not some.size:
            return None
        comm = self._domain.comm

        def rub(motion: FloatArray) -> FloatArray:
            none = np.zeros(len(motion))
            rubbed = (at.rub(motion, self._data.bounds) for at in self.at_contacts)
            return np.asarray(comm.allreduce(sum(rubbed, none)))

        motion = driven_motion(some, normals, self.work, rub)
        push, held = float(self.work @ motion), float(rub(motion) @ motion)
        # Ignore a motion of size zero, or of NaN after a solve that broke down.
        rounding = _DIGITS * float(np.linalg.norm(self.work) * np.linalg.norm(motion))
        if not push > held * (1.0 + _REACHED) + rounding:
            return None
        # A slide of length 1, or a turn by the angle 1.
        moved, turn = spin(self._of_part(motion)[1])
        words = self._words(motion)
        rate = float(np.linalg.norm(moved if words.startswith("translation") else turn))
        how = "lifts off" if len(normals) else "slides"
        depends = any(at.contact.friction.depends_on_slip for at in self.at_contacts)
        of_which = "the solver reached" + ", which another slip changes" * depends
        return (
            f"friction cannot hold the body with the friction bound that {of_which}: it {how} "
            f"(rigid motion: {words}), which needs {push / rate:.4g}, and friction holds "
            f"{held / rate:.4g}"
        )

    def _words(self, motion: FloatArray) -> str:
        """A motion (f,) of the part in words; collective."""
        name, share = self._of_part(motion)
        words = describe_motion(share, self._domain.bounding_box)
        return words if len(self.parts) == 1 else f"{words} of {name}"

    def _of_part(self, motion: FloatArray) -> tuple[str, FloatArray]:
        """The part that a motion (f,) moves the most, and the coefficients (m,) of its motion."""
        ends = np.cumsum([free.shape[1] for _, free in self.parts])
        shares = np.split(motion[: self.of_body], ends[:-1])
        most = int(np.argmax([np.linalg.norm(share) for share in shares]))
        name, free = self.parts[most]
        return name, np.asarray(free @ shares[most])

    def require_tools_held(self) -> None:
        """Raise InputError if the part can move with its tools as one rigid body; collective."""
        if not self._tools or not self.of_body:
            return
        local = np.sum([at.gram() for at in self.at_contacts], axis=0)
        gram = self._domain.comm.allreduce(local)
        sizes = np.diag(gram)
        for motion in null_motions(gram, sizes).T:
            moves = np.abs(motion * np.sqrt(sizes))[self.of_body :]
            if np.any(moves > _ROUNDING):
                raise InputError(
                    "body and foundations can move together as one rigid body "
                    f"({self._words(motion)}): the forces fix how hard the foundations press, and "
                    "nothing fixes where; hold a component on a boundary part in "
                    "loads.displacements, or leave out one foundation.force",
                    self._tools[0].key,
                )


@dataclass(frozen=True)
class Held:
    """A part of the body, and what holds it.

    - ``by``: the boundary parts of each kind that holds it, in words
    - ``free``: the number of rigid motions that displacement conditions and springs permit
    - ``sliding``: of these, motions that only friction can stop
    - ``sprung``: motions that springs stop and displacement conditions do not
    """

    name: str
    by: Mapping[str, Sequence[str]]
    free: int
    sliding: int
    sprung: int

    def __str__(self) -> str:
        return " and ".join(f"{what} on {', '.join(on)}" for what, on in self.by.items() if on)


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

    def held(self, conditions: Sequence[Support | Displacement]) -> list[Held]:
        """How each part is held, whatever the loads, by these conditions among others."""
        domain, data, held = self._domain, self._data, {}
        by: dict[str, list[str]] = {
            name: [part for each in conditions if isinstance(each, kind) for part in each.on]
            for name, kind in (("displacements", Displacement), ("supports", Support))
        }
        by["springs"] = [spring.on for spring in data.springs if isinstance(spring, Springs)]
        touching = [name for contact in data.contacts for name in (*contact.on, *contact.against)]
        for group, motions in self._groups():
            counts = [free.shape[1] for _, free in motions.parts]
            loosest = group[int(np.argmax(counts))]
            for number, free in zip(group, counts, strict=True):
                dofs = dofs_of(domain, self._space, number)
                stopped = free_motions(domain, self._space, self._constraints, dofs).shape[1] - free
                # Bodies that touch each other may slide together: they count once.
                slides = sliding_motions(motions.normals).shape[1] if number == loosest else 0
                contact = "contact and friction" if slides else "contact"
                of_part = by | {contact: touching if free else []}
                on = {what: _touching(domain, number, names) for what, names in of_part.items()}
                held[number] = Held(domain.part_names[number], on, free, slides, stopped)
        return [held[number] for number in sorted(held)]

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
                    f"{name} is loose: it shares no {shared} with the other cells: {error}",
                    error.key,
                ) from None

    def describe_slide(self) -> str | None:
        """A motion c that neither contact nor friction stops, in words, or None.

        Two searches, for each part of the body:

        - In equilibrium ``(f, c) = int p c_nu - sigma_tau . c_tau``.  Where mu does not depend on
          the slip and R has no negative entry, this is at most ``int p (c_nu + R* (mu |c_tau|))``
          for the pressure p >= 0.  So a motion with ``c_nu + R* (mu |c_tau|) <= 0`` at all nodes
          and ``(f, c) > 0`` proves that there is no equilibrium on this mesh, whatever the friction
          bound.
        - A motion that slides or lifts off, ``c_nu <= 0``, with ``(f, c) > int G |c_tau|`` proves
          for the present bound G alone that there is no equilibrium.
        """
        names = self._domain.part_names
        for group, motions in self._groups():
            if not motions.of_body:
                continue
            words = motions.describe_unheld() or motions.describe_slide()
            if words is not None:
                of = " and ".join(names[number] for number in group)
                return f"{of}: {words}" if len(names) > 1 else words
        return None

    def is_unheld(self) -> bool:
        """Whether the first search of :meth:`describe_slide` has found a motion, with its proof."""
        return any(
            motions.of_body and motions.describe_unheld() is not None
            for _, motions in self._groups()
        )

    def describe_loose(self) -> str | None:
        """A rigid motion that the present loads and tools do not resist, in words, or None.

        Tools may press the body less now than at other times.
        """
        for _, motions in self._groups():
            try:
                motions.require_held(motions.work)
            except InputError as error:
                return str(error)
        return None

    def loose(self) -> tuple[list[FloatArray], FloatArray]:
        """The rigid motions of each part that conditions and springs leave free.

        For each part the coefficients (m, f) of its motions, and the values (g, n) of the motions
        of all parts at the local dofs, ghosts included.
        """
        parts = [self._of_part(number) for number in range(len(self._domain.part_names))]
        return [free for free, _, _ in parts], np.vstack([fields for _, fields, _ in parts])

    def _of_part(self, number: int) -> tuple[FloatArray, FloatArray, BoolArray]:
        """The coefficients (m, f) of the free motions of a part, their values (f, n), its dofs."""
        domain, space = self._domain, self._space
        dofs = dofs_of(domain, space, number)
        free = free_motions(domain, space, self._constraints, dofs)
        fields = (free.T @ rigid_motions(space, domain.axisymmetric)) * dofs
        past = motions_past(self._data.springs, space, fields)
        return free @ past, past.T @ fields, dofs

    def _groups(self) -> Iterator[tuple[tuple[int, ...], GroupMotions]]:
        """The numbers of the parts that touch each other, and their motions."""
        domain, data = self._domain, self._data
        groups = [{number} for number in range(len(domain.part_names))]
        for contact in data.contacts:
            if contact.against:
                facets = domain.facets((*contact.on, *contact.against))
                touching = domain.comm.allgather(np.unique(domain.parts[domain.owners(facets)]))
                joined = set(map(int, np.concatenate(touching)))
                apart = [group for group in groups if not group & joined]
                groups = [*apart, set().union(*(group for group in groups if group & joined))]
        for group in sorted(tuple(sorted(group)) for group in groups):
            frees, fields, dofs = zip(*map(self._of_part, group), strict=True)
            names = [domain.part_names[number] for number in group]
            parts, marks = list(zip(names, frees, strict=True)), np.logical_or.reduce(dofs)
            yield group, GroupMotions(domain, self._space, data, parts, np.vstack(fields), marks)


def _touching(domain: Domain, number: int, names: Sequence[str]) -> tuple[str, ...]:
    """The named boundary parts that have facets of one part of the body; collective."""
    names = list(dict.fromkeys(names))
    is_touching = [
        bool(np.any(domain.parts[domain.owners(domain.facets((name,)))] == number))
        for name in names
    ]
    anywhere = np.any(domain.comm.allgather(is_touching), axis=0)
    return tuple(name for name, touches in zip(names, anywhere, strict=True) if touches)
