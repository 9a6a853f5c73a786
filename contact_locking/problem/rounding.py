"""The rounding in the forces that displacements cause, which every residual contains."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem, la

from contact_locking.arrays import FloatArray
from contact_locking.fem.compiled import JointForm
from contact_locking.parallel import maximum
from contact_locking.problem import forms
from contact_locking.problem.rigidity.at_contact import LooseMotion

# The rounding of a sum of products is a few times this share of the summands.
ROUNDING = 64.0 * float(np.finfo(float).eps)


class Rounding:
    """The rounding in ``a(u, .)``, as norms over all dofs; all of it is collective.

    ``loose`` knows the rigid motions that the conditions leave free, if there are any.
    """

    def __init__(
        self, data: forms.ProblemData, u: fem.Function, loose: LooseMotion | None = None
    ) -> None:
        space = u.function_space
        self._u, self._loose = u, loose
        self._magnitudes = JointForm(forms.force_magnitudes(u, ufl.TestFunction(space), data))
        self._work = la.vector(space.dofmap.index_map, space.dofmap.index_map_bs)

    @property
    def anchored(self) -> FloatArray:
        """The displacement without rigid motions that the data do not make."""
        u = self._u.x.array
        return u.copy() if self._loose is None else self._loose.anchored(u)

    def in_forces(self) -> float:
        """The rounding in ``a(u, .)`` for :attr:`anchored` u."""
        return self._in_forces_of(self.anchored)

    def raise_above(self, acting: float, tolerance: float) -> float:
        """``max(acting, rounding/tolerance)`` with :meth:`in_forces`.

        A residual of ``tolerance`` times this force is at least the rounding in ``u``.
        """
        # An upper bound of the rounding, which saves the assembly where larger forces act.
        if largest_displacement(self._u) * self._of_one <= tolerance * acting:
            return acting
        return max(acting, self.in_forces() / tolerance)

    @cached_property
    def _of_one(self) -> float:
        """:meth:`in_forces` if ``|u| = 1`` everywhere is what the data ask for."""
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
