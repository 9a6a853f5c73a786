"""A contact on the mesh: nodes, gaps, normals and friction of one part of Gamma_C."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.contact.contact import Contact, Coulomb
from contact_locking.contact.coulomb import Identity
from contact_locking.contact.foundation import PlacedFoundation, RigidFoundation
from contact_locking.contact.surface import ContactSurface
from contact_locking.errors import InputError, with_key
from contact_locking.fem.fields import Clock
from contact_locking.fem.spaces import Element
from contact_locking.findings import Finding
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import agree, maximum, on_any_rank, on_every_rank
from contact_locking.shapes.shape import RigidMotion
from contact_locking.supports.conditions import Constraints

# The friction bound at nodes that cannot slide, over the largest.
_TINY = 1e-4
# An overlap below this share of the extent of the body is rounding; a turn of normals is notable
# above this share of the friction coefficient.
_TOUCHING, _NOTABLE = 1e-9, 0.1
# A pairing is kept if its normals and gaps are those at the solution to this accuracy.
_SAME = 1e-3


@dataclass(frozen=True)
class ContactState:
    """What friction remembers of the previous step, k - 1; zeros before the first step.

    Friction acts on the slip of the present step, ``u_tau - u_{k-1,tau}``, and its coefficient
    depends on the accumulated slip ``s_k = sum_j |u_{j,tau} - u_{j-1,tau}|``.

    - ``place``, ``slip``: ``u_{k-1}`` (k, d) and ``s_{k-1}`` (k,) at the owned nodes of the contact
    - ``travel``, ``motion``: how far a force had moved the foundation (d,), and its given motion
    - ``displacement``: ``u_{k-1}`` at all local dofs, if bodies are paired anew; else None
    - ``touches``: whether any node of any rank touched
    """

    place: FloatArray
    slip: FloatArray
    travel: FloatArray
    motion: RigidMotion
    displacement: FloatArray | None = None
    touches: bool = True

    @classmethod
    def at_rest(cls, nodes: int, dim: int) -> ContactState:
        """Nothing has moved."""
        place, slip = np.zeros((nodes, dim)), np.zeros(nodes)
        return cls(place, slip, np.zeros(dim), RigidMotion.rest(dim))


class NodalContact:
    """Signorini's conditions (5) and Coulomb's law (6) at the nodes of one part of Gamma_C.

    - ``concept``, ``key``: the data of the contact, and its name in messages
    - ``on``, ``against``: its boundary parts, and those of the other body (none for a foundation);
      between two bodies displacements are jumps
    - ``surface``: the nodes of the contact with their weights
    - ``foundation``: at its present position
    - ``normals``, ``gaps``: the contact normals (k, d), and the limited values of the gap (k,)
    - ``friction``, ``regularisation``: the law of the friction bound, and the length eps of (22)
    - ``free``: (k,) nodes whose normal displacement is not prescribed; contact acts only there
    - ``slides``: (k,) nodes at which conditions permit a slip
    - ``state``: what friction remembers of earlier steps
    - ``travel``, ``drag``: how far forces have moved the foundation (d,), and its motion in the
      step (k, d)
    - ``references``: ``(u_{k-1} + drag)_tau`` (k, d), because slip is relative to the foundation

    The argument ``slip`` is the default of the regularisation.  The constructor is collective and
    raises InputError for a foundation behind Gamma_C.
    """

    def __init__(
        self,
        concept: Contact,
        surface: ContactSurface,
        constraints: Constraints,
        slip: float,
        clock: Clock,
    ) -> None:
        self.concept, self.key, self.on = concept, concept.key, concept.on
        self.surface, self._constraints, domain = surface, constraints, surface.domain
        self.clock = clock
        self.foundation: PlacedFoundation = (
            PlacedFoundation(domain, concept.gap, f"{self.key}.gap", clock)
            if concept.foundation is None
            else RigidFoundation(domain, concept.foundation, f"{self.key}.foundation", clock)
        )
        gap, normals = self.foundation.at_nodes(surface)
        self._first_gap = gap
        self.free = surface.free_nodes(normals, constraints)
        self.slides = surface.sliding_nodes(constraints)
        self.against = tuple(concept.against or ())
        self._sides: IntArray = surface.sides(normals)
        friction = concept.friction or Coulomb()
        self._kernel = friction.kernel
        self.friction = friction.on(surface, self._kernel.on(surface, self.free, self._sides))
        self.friction.key = concept.friction_key("coefficient")
        regularisation = friction.regularisation
        self.regularisation = slip if regularisation is None else regularisation
        count, dim = len(surface.nodes), domain.dim
        self.normals, self.gaps = normals, surface.limited_gap(gap)
        self.references: FloatArray = np.zeros((count, dim))
        self.state = ContactState.at_rest(count, dim)
        self.travel: FloatArray = np.zeros(dim)
        self._gaps = self.gaps
        # How far the foundation itself has moved in the step, without its travel.
        self._moved: FloatArray = np.zeros((count, dim))
        self.drag = self._moved
        if self.foundation.moves:
            self._set_gaps(self._gaps, normals)

    def findings(self) -> list[Finding]:
        """Findings about its data; collective."""
        surface, domain = self.surface, self.surface.domain
        findings = surface.findings()
        depth = -maximum(domain.comm, self._first_gap, -np.inf)
        # The whole body is inside if Gamma_C is at least as deep as the body is wide.
        if depth >= np.ptp(domain.bounding_box, axis=0).min():
            kind = "foundation" if self.foundation.has_shape else "gap"
            findings.append(Finding("gap.inside", f"{self.key}.{kind}", depth=depth))
        findings += self.foundation.findings(surface, self._first_gap)
        smoothing = self.concept.friction_key("smoothing")
        findings += [x.at(f"{smoothing}.{x.key}") for x in self._kernel.findings(surface)]
        if self.foundation.has_shape and not self.moves:
            findings += self._overlap()
        return findings

    def _overlap(self) -> list[Finding]:
        """The finding about a curved foundation with friction that overlaps the body; collective.

        If depths and normals vary, the foundation has moved partly along the body on its way, which
        would be slip.  A press fit on a shaft has uniform depths, and the normals of the body.
        """
        surface, domain = self.surface, self.surface.domain
        mu: FloatArray = np.ones(len(surface.nodes))
        if self.friction.is_coulomb:
            mu = self.friction.coefficient(np.zeros_like(mu))
        depth = np.where(self.free, -self.gaps, 0.0)
        inside = depth > _TOUCHING * domain.extent
        data = (depth, self.normals, surface.body_normals, mu)
        depth, normals, outward, mu = (
            np.concatenate(domain.comm.allgather(values[inside])) for values in data
        )
        if not len(depth):
            return []
        turn = float(np.linalg.norm(normals - normals.mean(axis=0), axis=1).max())
        tilt = float(np.linalg.norm(normals - outward, axis=1).max())
        least = _NOTABLE * min(float(mu.max()), 1.0)
        is_even = tilt <= least and depth.min() > 0.5 * depth.max()
        if least == 0.0 or turn <= least or is_even:
            return []
        key = f"{self.key}.foundation"
        return [Finding("foundation.overlap", key, depth=depth.max(), turn=turn)]

    def constant_support(self) -> str | None:
        """Where, in words, R preserves constants next to a held node, or None; collective."""
        domain, bound = self.surface.domain, self.friction
        if bound.frictionless or isinstance(bound.smoothing, Identity):
            return None
        held = np.concatenate(domain.comm.allgather(self.surface.points[~self.free]))
        if not len(held) or not bound.smoothing.keeps_constants:
            return None
        return domain.where(held[np.lexsort(held.T[::-1])[0]])

    def set_memory(self, state: ContactState) -> None:
        """Begin a step with what friction remembers."""
        self.state = state
        self._refresh()

    def update_foundation(self) -> None:
        """Move the foundation to its present position, or pair the bodies anew; collective.

        Raises Misplaced for a foundation that has moved behind Gamma_C.
        """
        surface, displacement = self.surface, self.state.displacement
        before = surface.frame
        is_anew = before is not None and self.pairs_anew and before.displacement is not displacement
        if is_anew and (frame := surface.frame_at(displacement, self.state.touches)) is not None:
            surface.set_frame(frame)
        if self.foundation.is_timed or is_anew:
            self._set_place(is_anew)

    def _set_place(self, is_anew: bool) -> None:
        """Set gap, normals and free nodes; ``is_anew`` says that the pairing is new; collective."""
        surface = self.surface
        if is_anew:
            before = self.state.displacement
            place = np.zeros_like(surface.points)
            if before is not None:
                place = surface.operator.values(before)
            self.state = replace(self.state, place=place)
        gap, normals = self.foundation.at_nodes(surface)
        self._set_gaps(surface.limited_gap(gap), normals)
        if not (self.foundation.moves or is_anew):
            return
        free, sides = surface.free_nodes(normals, self._constraints), surface.sides(normals)
        is_other = is_anew or on_any_rank(surface.domain.comm, free != self.free)
        if is_other or np.any(sides != self._sides):
            # R ignores nodes that are not free, and averages over each side separately.
            if not self.friction.frictionless:
                self.friction.smoothing.destroy()
                self.friction.smoothing = self._kernel.on(surface, free, sides)
            self.free, self._sides = free, sides
            self.slides = surface.sliding_nodes(self._constraints)

    def turn(self, u: fem.Function, presses: BoolArray) -> float:
        """The change of the normals at the nodes ``presses`` (k,) by pairing anew; collective.

        It is an angle, if small, and 0 for a foundation.
        """
        frame = self.surface.frame_at(u.x.array, must_face=False)
        if frame is None:
            return 0.0
        turns = np.linalg.norm(frame.normals - self.normals, axis=1)
        return maximum(self.surface.domain.comm, turns[presses & frame.faces])

    def update_pairs(self, u: fem.Function, touches: BoolArray, settled: bool) -> bool:
        """Pair the bodies as they are at the solution u; True if that changes anything; collective.

        It does if a normal turns by more than 1e-3 at a node that ``touches`` (k,), or a gap
        changes by more than 1e-3 of the largest jump, or of the range of displacements along the
        normal, because gaps are no more accurate if bodies slide far.  Gaps of nodes that touch
        have not changed if their forces have ``settled``: bodies that stick have next to no jump.
        """
        surface = self.surface
        if surface.frame is None or not self.pairs_anew:
            return False
        comm = surface.domain.comm
        frame = surface.frame_at(u.x.array.copy(), on_any_rank(comm, touches))
        assert frame is not None
        jump = surface.operator.values(u.x.array)
        opening = self.gaps - self.split_nodal(jump)[0]
        anew = frame.distance + self.gaps - surface.distance
        entry = np.maximum(-anew, 0.0) - np.maximum(-opening, 0.0)
        # Held nodes may be inside the other body, because their displacement is prescribed.
        may_enter = frame.faces & (self.free | ~surface.frame.faces)
        changes = np.where(may_enter, entry, 0.0)
        changes[touches] = 0.0 if settled else np.abs(anew - opening)[touches]
        turns = np.linalg.norm(frame.normals - self.normals, axis=1)
        is_same = maximum(comm, turns[touches]) <= _SAME
        largest = maximum(comm, np.linalg.norm(jump[surface.frame.faces], axis=1))
        approach = np.minimum(surface.extents(u.x.array, self.normals), largest)
        is_same &= not on_any_rank(comm, changes > _SAME * approach)
        is_same &= not on_any_rank(comm, touches & ~frame.faces)
        if not is_same:
            surface.set_frame(frame)
            self._set_place(is_anew=True)
        return not is_same

    def _set_gaps(self, gaps: FloatArray, normals: FloatArray) -> None:
        self._gaps = gaps
        self._moved = self.foundation.drag(self.surface, self.state.motion)
        self.normals = normals
        self._refresh()

    def move_foundation(self, travel: FloatArray) -> None:
        """Set the ``travel`` (d,) of the foundation by forces."""
        self.travel = travel
        self._refresh()

    def _refresh(self) -> None:
        """Update gaps, drag and references to the travel of the foundation."""
        self.gaps = self._gaps + np.sum(self.normals * self.travel, axis=1)
        self.drag = self._moved + (self.travel - self.state.travel)
        self.references = self.split_nodal(self.state.place + self.drag)[1]

    @property
    def moves(self) -> bool:
        """Whether the foundation moves, by a given motion or by forces."""
        return self.foundation.moves or self.is_free

    @property
    def pairs_anew(self) -> bool:
        """Whether two bodies are paired anew in each step."""
        return self.surface.frame is not None and self.concept.pair != "once"

    def slid(self, u: fem.Function) -> FloatArray:
        """How far (k,) the nodes have slid off the points that they were paired with."""
        if self.pairs_anew:
            return np.zeros(len(self.surface.nodes))
        return np.asarray(np.linalg.norm(self.split(u)[1], axis=1))

    @property
    def is_free(self) -> bool:
        """Whether the travel of the foundation is an unknown."""
        return self.concept.is_free

    def split(self, u: fem.Function) -> tuple[FloatArray, FloatArray]:
        """``u_nu`` (k,) and ``u_tau`` (k, d) at the nodes, of the limited values of u."""
        return self.split_nodal(self.surface.operator.values(u.x.array))

    def split_nodal(self, vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The normal components (k,) and the tangential parts (k, d) of vectors (k, d)."""
        normals = self.normals
        along = np.einsum("ki,ki->k", vectors, normals)
        return along, vectors - along[:, None] * normals

    def acting(self, values: FloatArray) -> FloatArray:
        """Values (k,), set to zero at the nodes that are not free."""
        return np.where(self.free, values, 0.0)

    def rubbing(self, bounds: FloatArray) -> FloatArray:
        """Friction bounds (k,), set to zero at nodes that are not free, tiny where nothing slides.

        A cone under a bound of zero has no interior.
        """
        return self.acting(np.where(self.slides, bounds, _TINY * bounds))

    def friction_bound(self, u: fem.Function, pressure: FloatArray) -> FloatArray:
        """The friction bound (k,) of a displacement and a pressure (k,); collective.

        It is zero at the nodes that are not free, although R of the pressure is not.
        """
        return self.rubbing(self.friction.evaluate(pressure, self.slips(u)))

    def increment(self, u: fem.Function) -> FloatArray:
        """The slip of the step, ``u_tau - u_{k-1,tau}`` (k, d), at the nodes.

        On a foundation that moves the slip is relative to it.
        """
        return self.split(u)[1] - self.references

    def slips(self, u: fem.Function) -> FloatArray:
        """The accumulated slip ``s_k = s_{k-1} + |u_tau - u_{k-1,tau}|`` (k,) at the nodes."""
        return self.state.slip + np.linalg.norm(self.increment(u), axis=1)

    def state_after(self, u: fem.Function, touches: BoolArray, holds: BoolArray) -> ContactState:
        """What friction remembers after a step with the displacement u; collective.

        ``touches`` (k,) marks the nodes that touch.  Nodes that stick without regularisation, which
        ``holds`` (k,) marks, keep their reference: errors of the solver would add up over steps.
        """
        along, tangential = self.split(u)
        place = np.where(holds[:, None], self.references, tangential)
        slip = np.where(holds, self.state.slip, self.slips(u))
        place = place + along[:, None] * self.normals
        displacement = u.x.array.copy() if self.pairs_anew else None
        motion, comm = self.foundation.motion(), self.surface.domain.comm
        is_touching = on_any_rank(comm, touches)
        return ContactState(place, slip, self.travel, motion, displacement, is_touching)

    def restore_step(
        self, reference: FloatArray, slip: FloatArray, displacement: FloatArray | None
    ) -> None:
        """Restore what a solved step began with: ``reference`` (k, d), slip (k,); collective.

        Bodies that are paired anew began it at the local values ``displacement``.
        """
        self.state = replace(self.state, slip=np.array(slip), displacement=displacement)
        if self.pairs_anew:
            self.update_foundation()
        self.references = reference

    def require_friction(self) -> None:
        """Raise InputError for a mu or a user's own bound that is negative or not finite somewhere.

        Both are evaluated without slip, and the bound at a small pressure.  Collective.
        """
        friction, surface, law = self.friction, self.surface, self.concept.friction
        comm, count = surface.domain.comm, len(surface.points)
        expression = law and law.coefficient and law.coefficient.expression

        def require(values: FloatArray, what: str, key: str) -> None:
            is_right = np.isfinite(values) & (values >= 0.0)
            if not on_every_rank(comm, is_right):
                wrong = np.concatenate(comm.allgather(values[~is_right]))
                raise InputError(f"{what}, and is {wrong[0]:g} somewhere", key)

        def coefficients() -> FloatArray:
            # On a rank without points only an expression can be evaluated.
            slip = np.zeros(count)
            return np.array(friction.law(surface.points, slip)) if count or expression else slip

        key = self.concept.friction_key("coefficient")
        mu = agree(comm, lambda: with_key(key, coefficients))
        require(mu, "mu must be a finite number from 0 up everywhere", key)
        if friction.is_coulomb:
            return
        key, kind = f"{self.key}.friction", type(friction).__name__
        expected = f"evaluate of {kind} must give the friction bound (k,)"
        bound: Any = friction.evaluate(np.full(count, _SLIGHT), np.zeros(count))

        def require_shape() -> None:
            if np.shape(bound) != (count,):
                shape = np.shape(bound)
                raise InputError(f"{expected}, here ({count},), not the shape {shape}", key)

        agree(comm, require_shape)
        require(np.asarray(bound), f"{expected} of finite numbers from 0 up without slip", key)

    def norm(self, values: FloatArray) -> float:
        """The L2 norm on this part of Gamma_C by the nodal weights; collective."""
        local = float(np.sum(self.surface.weights * values**2))
        return float(np.sqrt(self.surface.domain.comm.allreduce(local)))


class BoundsInForce:
    """The friction bound G in force at each contact, a stress; initially zero.

    ``bounds[contact]`` are the values (k,) at the owned nodes of the contact.
    """

    def __init__(self, contacts: Sequence[NodalContact]) -> None:
        self._bounds: dict[NodalContact, FloatArray] = {
            contact: np.zeros(len(contact.surface.nodes)) for contact in contacts
        }

    def __getitem__(self, contact: NodalContact) -> FloatArray:
        return self._bounds[contact]

    def __setitem__(self, contact: NodalContact, values: FloatArray) -> None:
        self._bounds[contact] = np.array(values)

    def at(self, contacts: Iterable[NodalContact]) -> list[FloatArray]:
        """The values at some contacts."""
        return [self[contact] for contact in contacts]

    def set(self, contacts: Iterable[NodalContact], values: Iterable[FloatArray]) -> None:
        """Set the values at some contacts."""
        for contact, bound in zip(contacts, values, strict=True):
            self[contact] = bound


def joint_norm(contacts: Sequence[NodalContact], values: Sequence[FloatArray]) -> float:
    """The L2 norm over all contacts of values (k,) for each contact; collective."""
    norms = [contact.norm(local) for contact, local in zip(contacts, values, strict=True)]
    return float(np.linalg.norm(norms)) if len(norms) > 1 else sum(norms)


def place_of(
    contact: Contact, domain: Domain, space: fem.FunctionSpace, element: Element
) -> ContactSurface:
    """The surface of a contact, paired with the other body if there is one; collective."""
    if contact.against is None:
        return ContactSurface(domain, space, contact.on, f"{contact.key}.on", element)
    # `check` of one body does without SciPy, whose import takes a tenth of its time.
    from contact_locking.contact.paired_surface import PairedSurface

    return PairedSurface(domain, space, contact, element)


# At this pressure, slight in every unit, a friction bound shows its sign; at 0 it may be 0.
_SLIGHT = 1e-12
