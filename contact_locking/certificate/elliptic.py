"""Linear elliptic problems of the certificate: dual norms and lifts of boundary values."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.errors import raise_callback_error
from contact_locking.fem.joint_forms import JointForm, action
from contact_locking.problem import forms
from contact_locking.solver.linear.ksp import create_ksp, default_options, destroy_ksp
from contact_locking.supports.conditions import Constraints

# A prefix of its own: the options for the nonlinear solve do not concern these solves.
_PREFIX = "contact_locking_certificate_"
# The tolerance of CG, enough for a bound that holds with a margin.
_RTOL = 1e-8


class NotApplicable(Exception):
    """A part of the certificate does not exist for this problem; the message says why."""


def require_still_foundations(state: SolvedState) -> None:
    """Raise NotApplicable if a force pushes a foundation, whose place is then an unknown."""
    if state.problem.data.tools:
        raise NotApplicable(
            "a force pushes a foundation, and the proof is for foundations in a known place"
        )


class EllipticProblem:
    """``b(z, v) = r(v)`` for all v without a held part; made by :func:`elliptic_problem`.

    Arrays are local values of the displacement space, ghosts included.
    """

    def __init__(self, state: SolvedState, bilinear: Expr, constraints: Constraints) -> None:
        self._space = state.problem.u.function_space
        self._owned = self._space.dofmap.index_map.size_local * self._space.dofmap.index_map_bs
        self._bilinear = bilinear
        self.constraints = constraints
        form = JointForm(bilinear)
        self.matrix = form.create_matrix()
        constraints.assemble_matrix(form, self.matrix)
        self.matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._nullspace = state.system.near_nullspace()
        self.matrix.setNearNullSpace(self._nullspace)
        comm = state.comm
        options = default_options(state.settings.linear, state.dim, state.system.size, comm)
        self.ksp = create_ksp(comm, options | {"ksp_rtol": _RTOL}, prefix=_PREFIX)
        self.ksp.setOperators(self.matrix)

    def solve(
        self, right: FloatArray | None = None, values: fem.Function | None = None
    ) -> fem.Function:
        """The z with ``b(z, v) = r(v)`` and the held part of ``values``; collective.

        ``right`` are the nodal forces r.  Without ``values`` the held part is zero.  Raises
        NotApplicable if the linear solver fails.
        """
        solution = fem.Function(self._space)
        forces = np.zeros(self._owned) if right is None else right[: self._owned]
        if values is not None:
            solution.x.array[:] = self.constraints.held_part(values.x.array)
            vector = la.vector(self._space.dofmap.index_map, self._space.dofmap.index_map_bs)
            JointForm(action(self._bilinear, solution)).assemble_vector(vector)
            forces = forces - vector.array[: self._owned]
        b, x = self.matrix.createVecLeft(), self.matrix.createVecRight()
        b.array_w[:] = self.constraints.free_part(forces)
        try:
            self.ksp.solve(b, x)
        except PETSc.Error as error:
            raise_callback_error(error)
            raise NotApplicable("the linear solve that it takes failed") from error
        # CG may change the held part.
        solution.x.array[: self._owned] += self.constraints.free_part(x.array_r)
        solution.x.scatter_forward()
        for item in (b, x):
            item.destroy()
        return solution

    def destroy(self) -> None:
        destroy_ksp(self.ksp)
        for item in (self.matrix, self._nullspace):
            item.destroy()


@contextmanager
def elliptic_problem(
    state: SolvedState, bilinear: Expr, constraints: Constraints
) -> Iterator[EllipticProblem]:
    """An :class:`EllipticProblem` that is destroyed after the block; collective."""
    problem = EllipticProblem(state, bilinear, constraints)
    try:
        yield problem
    finally:
        problem.destroy()


def inner_product(space: fem.FunctionSpace, data: forms.ProblemData) -> Expr:
    """``(w, v)_V = int eps(w) : eps(v)`` (10)."""
    v, w = ufl.TestFunction(space), ufl.TrialFunction(space)
    return ufl.inner(data.strain(w), data.strain(v)) * data.element.elastic_dx(data.dx)


def elasticity(state: SolvedState) -> Expr:
    """The bilinear form ``a(w, v)``."""
    space = state.problem.u.function_space
    return forms.elastic_form(ufl.TrialFunction(space), ufl.TestFunction(space), state.problem.data)


def springs(state: SolvedState, stiffness: float) -> Expr:
    """``k int w_nu v_nu`` over Gamma_C."""
    space = state.problem.u.function_space
    v, w = ufl.TestFunction(space), ufl.TrialFunction(space)
    k = fem.Constant(space.mesh, stiffness)
    return forms.contact_stiffness(v, w, state.problem.contacts, k)
