"""The inner product of displacements, norms of traces, and largest eigenvalues."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from types import SimpleNamespace
from typing import Any

import ufl
from dolfinx.fem import petsc
from petsc4py import PETSc
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray
from contact_locking.certificate.elliptic import EllipticProblem, NotApplicable
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.errors import raise_callback_error
from contact_locking.fem import compiled

_PREFIX_OF_EIGENVALUES = "contact_locking_steklov_"
# The relative accuracy of an eigenvalue; a bound needs no more.
_ACCURACY = 1e-6

# Forms of one problem are the same objects in each solve, by which their compiled forms are kept.


def inner_product(state: SolvedState) -> Expr:
    """``(w, v)_V = int eps(w) : eps(v)`` (10)."""
    data, (v, w) = state.problem.data, state.system.bilinear.arguments()

    def make() -> Expr:
        return ufl.inner(data.strain(w), data.strain(v)) * data.element.elastic_dx(data.dx)

    return state.system.kept("inner product", make)


def require_held(state: SolvedState) -> None:
    """Raise NotApplicable unless displacement conditions alone hold the body."""
    if state.problem.free or state.problem.sprung:
        raise NotApplicable("displacement conditions alone do not hold the body")


def trace_norm(state: SolvedState, product: Expr, traces: ufl.Form) -> float:
    """``max sqrt(t(v, v)/b(v, v))`` over the displacements that are zero on Gamma_D; collective.

    ``product`` is b and ``traces`` is t, bilinear forms.  The result comes from below.  Raises
    NotApplicable if the eigenvalue solver fails.
    """
    constraints = state.problem.constraints
    surface = petsc.assemble_matrix(compiled.form(traces))
    surface.assemble()
    # The held part keeps the identity in the product and has no trace.
    mask = surface.createVecLeft()
    mask.array_w[:] = constraints.free_dofs()[: mask.getLocalSize()]
    surface.diagonalScale(mask, mask)
    constraints.supports.directions.eliminate(surface, holds=False)
    try:
        with closing(EllipticProblem(state, product, constraints)) as problem:
            return float(_largest(surface, problem.matrix, problem.ksp) ** 0.5)
    finally:
        for item in (mask, surface):
            item.destroy()


def largest_eigenvalue(comm: Any, size: int, operator: Callable[[FloatArray], FloatArray]) -> float:
    """The largest eigenvalue of a symmetric operator, from below; collective.

    The operator maps the ``size`` values of each rank to as many.  Raises NotApplicable if the
    eigenvalue solver fails.
    """

    def mult(matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array_w[:] = operator(x.array_r)

    sizes = ((size, None), (size, None))
    matrix = PETSc.Mat().createPython(sizes, SimpleNamespace(mult=mult), comm)
    matrix.setUp()
    try:
        return _largest(matrix)
    finally:
        matrix.destroy()


def _largest(
    matrix: PETSc.Mat, product: PETSc.Mat | None = None, inverse: PETSc.KSP | None = None
) -> float:
    from slepc4py import SLEPc

    solver = SLEPc.EPS().create(matrix.getComm())
    solver.setOptionsPrefix(_PREFIX_OF_EIGENVALUES)
    kinds = SLEPc.EPS.ProblemType
    solver.setOperators(matrix, product)
    solver.setProblemType(kinds.HEP if product is None else kinds.GHEP)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
    solver.setTolerances(tol=_ACCURACY)
    if inverse is not None:
        solver.getST().setKSP(inverse)
    try:
        solver.solve()
        if not solver.getConverged():
            raise NotApplicable("the eigenvalue solver did not converge")
        return float(solver.getEigenvalue(0).real)
    except PETSc.Error as error:
        raise_callback_error(error)
        raise NotApplicable("the eigenvalue solver failed") from error
    finally:
        solver.destroy()
