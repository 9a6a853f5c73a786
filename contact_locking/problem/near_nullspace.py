"""The motions that a body hardly resists, for algebraic multigrid."""

from __future__ import annotations

from dolfinx import fem
from petsc4py import PETSc

from contact_locking.problem.rigid_motions import rigid_motions


def near_nullspace(u: fem.Function) -> PETSc.NullSpace:
    """The rigid body motions of the space of a displacement, orthonormalised; collective."""
    basis: list[PETSc.Vec] = []
    # Away from its axis an axisymmetric body resists the motions of the plane little: with all
    # three of them multigrid took a third of the iterations.
    for motion in rigid_motions(u.function_space):
        vector = u.x.petsc_vec.duplicate()
        vector.array_w[:] = motion[: vector.getLocalSize()]
        for other in basis:
            vector.axpy(-vector.dot(other), other)
        vector.normalize()
        basis.append(vector)
    nullspace = PETSc.NullSpace().create(vectors=basis, comm=u.function_space.mesh.comm)
    for vector in basis:
        vector.destroy()
    return nullspace
