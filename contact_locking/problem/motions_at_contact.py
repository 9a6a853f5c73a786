"""Rigid motions of the body where it touches a foundation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.parallel import on_every_rank
from contact_locking.problem.contact import Contact
from contact_locking.problem.pushed_tool import PushedTool


class MotionsAtContact:
    """Rigid motions at the owned nodes of one contact on one part of the body, less its tool's."""

    def __init__(
        self, contact: Contact, motions: FloatArray, part: BoolArray, tools: Sequence[PushedTool]
    ) -> None:
        self.contact, self._own = contact, contact.surface.is_of(part)
        blocks = contact.surface.blocks[self._own]
        dim = contact.surface.domain.dim
        of_body = motions.reshape(len(motions), motions.shape[1] // dim, dim)[:, blocks]
        of_tools = np.zeros((len(tools), *of_body.shape[1:]))
        for number, tool in enumerate(tools):
            if tool.contact is contact:
                of_tools[number] = -tool.direction
        self._motions = np.concatenate([of_body, of_tools])
        #: The normal components (k, f).
        self.normals = np.einsum("fkd,kd->kf", self._motions, contact.normals[self._own])

    def gram(self) -> FloatArray:
        """The products (f, f) of the motions, summed over the nodes of this rank."""
        return np.asarray(np.einsum("fkd,gkd->fg", self._motions, self._motions))

    def knows_friction(self) -> bool:
        """Whether mu depends on nothing that is not known before a solve; collective."""
        bound, extent = self.contact.friction, self.contact.surface.domain.extent()
        slips = np.zeros(len(self.contact.free))
        same = np.array_equal(bound.coefficient(slips), bound.coefficient(slips + extent))
        return bound.is_coulomb and on_every_rank(self.contact.surface.domain.comm, same)

    def resistance(self, motion: FloatArray) -> FloatArray:
        """The derivative (k, f) of ``c_nu + R* (mu |c_tau|)`` at a motion (f,); collective."""
        contact, normals = self.contact, self.contact.normals[self._own]
        along = self._motions - np.einsum("kf,kd->fkd", self.normals, normals)
        slip = np.einsum("fkd,f->kd", along, motion)
        size = np.linalg.norm(slip, axis=1)
        towards = np.einsum("fkd,kd->fk", along, slip / np.where(size > 0.0, size, 1.0)[:, None])
        mu = contact.friction.coefficient(np.zeros(len(self._own))) * contact.free
        rubbed = np.zeros((len(motion), len(self._own)))
        rubbed[:, self._own] = towards
        taken = np.array([contact.friction.smoothing.adjoint(mu * row) for row in rubbed])
        return np.asarray(self.normals + taken[:, self._own].T)

    def taken(self, motion: FloatArray) -> float:
        """``int G |c|``: the largest work of friction along a sliding motion c (f,), local."""
        slip = np.linalg.norm(np.einsum("fkd,f->kd", self._motions, motion), axis=1)
        weights, bound = self.contact.surface.weights[self._own], self.contact.bounds[self._own]
        return float(weights @ (bound * slip))
