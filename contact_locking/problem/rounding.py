"""The rounding in the forces that displacements cause, which every residual contains."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem, la

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.fem.compiled import JointForm
from contact_locking.parallel import maximum
from contact_locking.problem import forms
from contact_locking.supports.conditions import Constraints

# A gap is closed if the normal displacement misses it by this share of it at most.
_CLOSED = 0.5
# The rounding of a sum of products is a few times this share of the summands.
ROUNDING = 64.0 * float(np.finfo(float).eps)


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
        self, motions: FloatArray, constraints: Constraints, contacts: Sequence[NodalContact]
    ) -> None:
        space = constraints.space
        self._comm, self._motions = space.mesh.comm, motions
        self._owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        self._constraints, self._contacts = constraints, contacts
        # A factorisation by ranks keeps the digits of bodies that are far from the origin.
        self._basis, triangle = np.linalg.qr(motions[:, : self._owned].T)
        self._triangles = np.vstack(self._comm.allgather(triangle))

    def anchored(self, u: FloatArray) -> FloatArray:
        """``u`` (local values) without the part of the free motions that the data do not cause.

        The size of a motion is measured on Gamma_C, which stops it; the deformation may move the
        body as far, too.  Collective.
        """
        seen = np.concatenate(self._comm.allgather(self._basis.T @ u[: self._owned]))
        motion = np.linalg.lstsq(self._triangles, seen)[0] @ self._motions
        distance, causes = 0.0, [self._constraints.held_part(u), u - motion]
        for contact in self._contacts:
            moved, present = (contact.surface.operator.values(v) for v in (motion, u))
            distance = max(distance, self._largest(moved))
            if contact.is_free:
                # The foundation follows the body, and gaps and slips are relative to its travel.
                continue
            gaps, along = contact.gaps, contact.split_nodal(present)[0]
            closed = np.isfinite(gaps) & (np.abs(along - gaps) <= _CLOSED * np.abs(gaps))
            causes += [gaps[closed], contact.references]
        length = sum(self._largest(values) for values in causes)
        share = min(1.0, length / distance) if distance > 0.0 else 1.0
        return np.asarray(u - (1.0 - share) * motion)

    def _largest(self, values: FloatArray) -> float:
        return maximum(self._comm, np.abs(values))


class Rounding:
    """The rounding in ``a(u, .)``, as norms over all dofs; collective.

    ``loose`` knows the rigid motions that the conditions leave free, if there are any.
    """

    def __init__(
        self, data: forms.ProblemData, u: fem.Function, loose: LooseMotion | None = None
    ) -> None:
        space = u.function_space
        self._u, self._loose = u, loose
        self._magnitudes = JointForm(forms.force_magnitudes(u, ufl.TestFunction(space), data))
        self._work = la.vector(space.dofmap.index_map, space.dofmap.index_map_bs)

    def in_forces(self) -> float:
        """The rounding in ``a(u, .)``, without rigid motions that the data do not cause."""
        u = self._u.x.array
        return self._in_forces_of(u if self._loose is None else self._loose.anchored(u))

    def raise_above(self, acting: float, tolerance: float) -> float:
        """``max(acting, rounding/tolerance)`` with :meth:`in_forces`.

        A residual of ``tolerance`` times this force is at least the rounding in ``u``.
        """
        # An upper bound of the rounding avoids the assembly if larger forces act.
        if largest_displacement(self._u) * self._of_one <= tolerance * acting:
            return acting
        return max(acting, self.in_forces() / tolerance)

    @cached_property
    def _of_one(self) -> float:
        """:meth:`in_forces` for ``|u| = 1`` everywhere."""
        components = self._u.function_space.dofmap.index_map_bs
        return self._in_forces_of(np.full_like(self._u.x.array, 1.0 / np.sqrt(components)))

    def _in_forces_of(self, displacement: FloatArray) -> float:
        kept = self._u.x.array.copy()
        self._u.x.array[:] = displacement
        self._magnitudes.assemble_vector(self._work)
        self._u.x.array[:] = kept
        return ROUNDING * float(la.norm(self._work))


def largest_displacement(u: fem.Function) -> float:
    """The largest ``|u|`` of all nodes; collective."""
    vectors = u.x.array.reshape(-1, u.function_space.dofmap.index_map_bs)
    return maximum(u.function_space.mesh.comm, np.linalg.norm(vectors, axis=1))
