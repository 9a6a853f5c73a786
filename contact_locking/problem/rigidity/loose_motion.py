"""Rigid motions that only contact or friction stops, and how much of them the data make."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.parallel import maximum
from contact_locking.supports.conditions import Constraints

# A gap is closed if the normal displacement misses it by this share of it at most.
_CLOSED = 0.5


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
            moved, stands = (contact.surface.limited.at_nodes(v) for v in (motion, u))
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
