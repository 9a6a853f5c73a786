"""Admissible fields, for proofs with the test function ``v = 0`` where 0 is not admissible.

A field w is admissible if w has the prescribed values on Gamma_D, ``w_nu <= gap`` on Gamma_C, and
``|eps(w)| <= M``, with the strain in every other set of strains as well.  For proofs with friction
w must not slip either: ``w_tau = 0`` on Gamma_C.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.certificate.elliptic import EllipticProblem, NotApplicable, elasticity
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.fem.trace import make_nodal
from contact_locking.parallel import on_any_rank, on_every_rank

# Rounding in strains and displacements, relative to the limit and to the body.
_ROUNDING = 1e-12


class Lifting:
    """Elastic fields with given values on Gamma_C and Gamma_D, with one factorisation for all.

    :meth:`close` is collective.
    """

    def __init__(self, state: SolvedState) -> None:
        self._state = state
        self._problem: EllipticProblem | None = None

    @cached_property
    def admissible(self) -> fem.Function | None:
        """An admissible field without slip, None for the zero field; collective.

        The field has the prescribed values on Gamma_D, ``w = min(gap, 0) nu`` on Gamma_C, and the
        least elastic energy.  Raises NotApplicable if its strain exceeds the locking limit, if
        values prescribed at nodes of Gamma_C slip or enter the foundation, and for a user's own
        energy, which no proof covers.
        """
        state = self._state
        if state.problem.data.own_energy is not None:
            raise NotApplicable("no proof covers the user's own energy")
        prescribed = fem.Function(state.problem.u.function_space)
        overlaps = any(np.any(fields.gap < 0.0) for fields in state.contacts)
        moves = state.problem.constraints.largest() > 0.0
        if on_every_rank(state.comm, not (overlaps or moves)):
            return None
        for fields in state.contacts:
            # At a node of two contacts the values add up, and the check below judges the sum.
            values = np.minimum(fields.gap, 0.0)[:, None] * fields.normal
            prescribed.x.array.reshape(-1, state.dim)[fields.surface.blocks] += values
        prescribed.x.scatter_forward()
        state.problem.constraints.apply(prescribed)
        self._make_nodal(prescribed)
        state.problem.constraints.apply(prescribed)
        lifted = self._elastic(prescribed)
        self._check(lifted)
        return lifted

    def push_back(self) -> fem.Function:
        """``c = [u_nu - gap]^+ nu`` on Gamma_C, summed over the contacts, and 0 on Gamma_D."""
        state = self._state
        values = fem.Function(state.problem.u.function_space)
        nodes = values.x.array.reshape(-1, state.dim)
        anywhere = False
        for fields in state.contacts:
            entered = np.maximum(fields.u_normal - fields.gap, 0.0)
            anywhere = anywhere or not self._nowhere(entered)
            nodes[fields.surface.blocks] += entered[:, None] * fields.normal
        values.x.scatter_forward()
        constraints = state.problem.constraints
        values.x.array[:] = constraints.free_part(values.x.array)
        self._make_nodal(values)
        values.x.array[:] = constraints.free_part(values.x.array)
        return self._elastic(values) if anywhere else values

    def close(self) -> None:
        if self._problem is not None:
            self._problem.destroy()

    def _elastic(self, values: fem.Function) -> fem.Function:
        if self._problem is None:
            state = self._state
            constraints = state.problem.constraints
            for fields in state.contacts:
                surface = fields.surface
                mark = surface.vector_function(np.ones((len(surface.nodes), state.dim)))
                blocks = np.flatnonzero(mark.x.array.reshape(-1, state.dim)[:, 0] > 0.0)
                constraints = constraints.with_fixed(blocks.astype(np.int32), mark)
            self._problem = EllipticProblem(state, elasticity(state), constraints)
        return self._problem.solve(None, values)

    def _make_nodal(self, values: fem.Function) -> None:
        """Replace the limited values on Gamma_C by nodal values; collective."""
        make_nodal(values, [fields.surface.limited for fields in self._state.contacts])

    def _check(self, lifted: fem.Function) -> None:
        state = self._state
        sets = state.points.sets
        excesses = [
            item.reach(item.measured(lifted)) - item.limit * (1.0 + _ROUNDING) for item in sets
        ]
        if not all([self._nowhere(excess) for excess in excesses]):
            raise NotApplicable(
                "the elastic displacement with the prescribed values exceeds the locking limit, "
                "and no other field was tried"
            )
        small = _ROUNDING * state.target.length
        for fields in state.contacts:
            normal, tangential = fields.contact.split(lifted)
            slip = np.linalg.norm(tangential, axis=1)
            if not self._nowhere(normal - fields.gap - small):
                raise NotApplicable(
                    "prescribed displacements at the edge of Gamma_C exceed the gap"
                )
            if not fields.contact.friction.frictionless and not self._nowhere(slip - small):
                raise NotApplicable("prescribed displacements at the edge of Gamma_C slip")

    def _nowhere(self, values: FloatArray) -> bool:
        """Whether no value of any rank is positive; collective."""
        return not on_any_rank(self._state.comm, values > 0.0)
