"""Rigid motions of the body where it touches a foundation."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from dolfinx import fem

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.contact.nodal_contact import BoundsInForce, NodalContact
from contact_locking.contact.travel import Travel
from contact_locking.parallel import maximum
from contact_locking.supports.conditions import Constraints

# A gap is closed if the normal displacement misses it by this share of it at most.
_CLOSED = 0.5


class MotionsAtContact:
    """Rigid motions at the owned nodes of one contact on some parts of the body.

    They are relative to the contact's tool, or to the body that it touches.  ``own`` marks the
    nodes among those of the contact.
    """

    def __init__(
        self,
        contact: NodalContact,
        motions: FloatArray,
        part: BoolArray,
        tools: Sequence[Travel],
    ) -> None:
        self.contact, self.own = contact, contact.surface.is_of(part)
        surface, dim = contact.surface, contact.surface.domain.dim
        at_nodes = np.array([surface.of_motion(motion) for motion in motions])
        of_body = at_nodes.reshape(len(motions), len(self.own), dim)[:, self.own]
        of_tools = np.zeros((len(tools), *of_body.shape[1:]))
        for number, tool in enumerate(tools):
            if tool.contact is contact:
                of_tools[number] = -tool.direction
        self._motions = np.concatenate([of_body, of_tools])
        #: The normal components (k, f).
        self.normals = np.einsum("fkd,kd->kf", self._motions, contact.normals[self.own])

    def gram(self) -> FloatArray:
        """The products (f, f) of the motions, summed over the nodes of this rank."""
        return np.asarray(np.einsum("fkd,gkd->fg", self._motions, self._motions))

    def tangents(self) -> FloatArray:
        """The tangential components (k d, f) at the nodes with friction."""
        rows = 0 if self.contact.friction.frictionless else len(self.normals)
        along = self._along[:, :rows]
        return along.reshape(len(along), -1).T

    def knows_friction(self) -> bool:
        """Whether the bound at any pressure p >= 0 is known before a solve; collective.

        It is ``mu R p >= 0`` with a mu that does not depend on the slip, by the word of the law,
        and with an R that has no negative entry.
        """
        bound = self.contact.friction
        if bound.frictionless:
            return True
        return bound.is_coulomb and not bound.depends_on_slip and bound.smoothing.is_positive()

    def largest_coefficient(self) -> float:
        """The largest mu at the nodes of this rank, without slip; collective."""
        mu = self.contact.friction.coefficient(np.zeros(len(self.own)))
        return float(np.max(mu[self.own], initial=0.0))

    def resistance(self, motion: FloatArray) -> FloatArray:
        """The derivative (k, f) of ``c_nu + R* (mu |c_tau|)`` at a motion (f,); collective."""
        contact = self.contact
        if contact.friction.frictionless:
            return self.normals
        mu = contact.friction.coefficient(np.zeros(len(self.own))) * contact.free
        rubbed = np.zeros((len(motion), len(self.own)))
        rubbed[:, self.own] = self._towards(motion)
        taken = np.array([contact.friction.smoothing.adjoint(mu * row) for row in rubbed])
        return np.asarray(self.normals + taken[:, self.own].T)

    def rub(self, motion: FloatArray, bounds: BoundsInForce) -> FloatArray:
        """The derivative (f,) of ``int G |c_tau|`` at a motion c (f,), local."""
        work = self.contact.surface.weights * bounds[self.contact]
        return self._towards(motion) @ work[self.own]

    @cached_property
    def _along(self) -> FloatArray:
        """The tangential parts (f, k, d)."""
        normals = self.contact.normals[self.own]
        return self._motions - np.einsum("kf,kd->fkd", self.normals, normals)

    def _towards(self, motion: FloatArray) -> FloatArray:
        """The derivative (f, k) of ``|c_tau|`` at a motion (f,)."""
        slip = np.einsum("fkd,f->kd", self._along, motion)
        size = np.linalg.norm(slip, axis=1)
        unit = slip / np.where(size > 0.0, size, 1.0)[:, None]
        return np.asarray(np.einsum("fkd,kd->fk", self._along, unit))


class LooseMotion:
    """The part of a displacement that is a rigid motion which the conditions leave free.

    Where friction cannot hold the body, a solver moves it on and on, until the rounding in a huge
    displacement is larger than the loads.  Forces must not count as balanced then.  But rounding in
    a displacement counts where the data ask for this displacement: prescribed values, gaps that
    have to close, earlier steps, and foundations that move.  The travel of a tool is no datum: it
    follows the body.

    ``motions`` (f, n) are the free rigid motions at the local dofs, ghosts included.
    """

    def __init__(
        self,
        space: fem.FunctionSpace,
        motions: FloatArray,
        constraints: Constraints,
        contacts: Sequence[NodalContact],
    ) -> None:
        self._comm, self._motions = space.mesh.comm, motions
        self._owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        self._constraints, self._contacts = constraints, contacts
        # A factorisation by ranks keeps the digits of bodies that are far from the origin.
        self._basis, triangle = np.linalg.qr(motions[:, : self._owned].T)
        self._triangles = np.vstack(self._comm.allgather(triangle))

    def anchored(self, u: FloatArray) -> FloatArray:
        """``u`` (local values) with no more of the free motions than the data make; collective.

        How far a motion goes is measured on Gamma_C, where it is stopped.  The
        deformation may move the body as far, too.
        """
        seen = np.concatenate(self._comm.allgather(self._basis.T @ u[: self._owned]))
        motion = np.linalg.lstsq(self._triangles, seen)[0] @ self._motions
        distance, made = 0.0, [self._constraints.held_part(u), u - motion]
        for contact in self._contacts:
            moved, stands = (contact.surface.operator.values(v) for v in (motion, u))
            distance = max(distance, self._largest(moved))
            if contact.is_free:
                # The foundation follows the body, and gaps and slips are relative to its travel.
                continue
            gaps, along = contact.gaps, contact.split_nodal(stands)[0]
            closed = np.isfinite(gaps) & (np.abs(along - gaps) <= _CLOSED * np.abs(gaps))
            made += [gaps[closed], contact.references]
        length = sum(self._largest(values) for values in made)
        share = min(1.0, length / distance) if distance > 0.0 else 1.0
        return np.asarray(u - (1.0 - share) * motion)

    def _largest(self, values: FloatArray) -> float:
        return maximum(self._comm, np.abs(values))
