"""Fields that the constraints admit: what proofs that test with ``v = 0`` need when 0 is not one.

A field is admissible if it has the prescribed values on Gamma_D, ``w_nu <= gap`` on Gamma_C and
``|eps(w)| <= M``.  For proofs with friction it must not slip either: ``w_tau = 0``.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from contact_locking.certificate.elliptic import EllipticProblem, NotApplicable, elasticity
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.laws.elasticity import strain

FloatArray = npt.NDArray[np.float64]

# Rounding in strains and displacements, relative to the limit and to the body.
_ROUNDING = 1e-12


class Lifting:
    """Elastic fields with given values on Gamma_C and Gamma_D; one factorisation for all of them.

    Close it collectively.
    """

    def __init__(self, state: SolvedState) -> None:
        self._state = state
        self._problem: EllipticProblem | None = None

    @cached_property
    def admissible(self) -> fem.Function | None:
        """An admissible field without slip, None if it is 0; collective, one factorisation.

        It takes the prescribed values on Gamma_D and ``w = min(gap, 0) nu`` on Gamma_C, with the
        least elastic energy.  Raises NotApplicable if that exceeds the locking limit, if values
        prescribed at nodes of Gamma_C slip or enter the foundation, and for an energy of the
        user's own, of which nothing is known.
        """
        state = self._state
        if state.problem.data.own_energy is not None:
            raise NotApplicable("there is an energy of the user's own, which no proof knows")
        prescribed = fem.Function(state.problem.u.function_space)
        given = [c.g.x.array for c in state.problem.constraints.conditions]
        overlaps = any(np.any(fields.gap < 0.0) for fields in state.contacts)
        zero = not overlaps and all(not np.any(values) for values in given)
        if state.problem.domain.comm.allreduce(zero, op=MPI.LAND):
            return None
        for fields in state.contacts:
            # At a node of two contacts both count, and the check below judges their sum.
            values = np.minimum(fields.gap, 0.0)[:, None] * fields.normal
            prescribed.x.array.reshape(-1, state.dim)[fields.surface.blocks] += values
        prescribed.x.scatter_forward()
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
        values.x.array[state.problem.constraints.dofs] = 0.0
        return self._elastic(values) if anywhere else values

    def close(self) -> None:
        if self._problem is not None:
            self._problem.destroy()

    def _elastic(self, values: fem.Function) -> fem.Function:
        if self._problem is None:
            state = self._state
            conditions = list(state.problem.constraints.conditions)
            for fields in state.contacts:
                surface = fields.surface
                mark = surface.vector_function(np.ones((len(surface.nodes), state.dim)))
                blocks = np.flatnonzero(mark.x.array.reshape(-1, state.dim)[:, 0] > 0.0)
                conditions.append(fem.dirichletbc(mark, blocks.astype(np.int32)))
            self._problem = EllipticProblem(state, elasticity(state), conditions)
        return self._problem.solve(None, values)

    def _check(self, lifted: fem.Function) -> None:
        state = self._state
        size = np.linalg.norm(state.points.interpolated(strain(lifted)), axis=(1, 2))
        if not self._nowhere(size - state.points.limit * (1.0 + _ROUNDING)):
            raise NotApplicable(
                "the elastic displacement that follows the prescribed values exceeds the locking "
                "limit, and no other admissible one was sought"
            )
        small = _ROUNDING * state.target.length
        for fields in state.contacts:
            normal, tangential = fields.contact.split(lifted)
            slip = np.linalg.norm(tangential, axis=1)
            if not self._nowhere(normal - fields.gap - small):
                raise NotApplicable("displacements prescribed on the edge of Gamma_C enter the gap")
            if not fields.contact.friction.frictionless and not self._nowhere(slip - small):
                raise NotApplicable("displacements prescribed on the edge of Gamma_C make it slip")

    def _nowhere(self, values: FloatArray) -> bool:
        """Whether no value on any rank is positive; collective."""
        local = bool(np.any(values > 0.0))
        return not self._state.problem.domain.comm.allreduce(local, op=MPI.LOR)
