"""The motions that a body hardly resists, for algebraic multigrid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from contact_locking.supports.rigid_motions import rigid_motions


def near_nullspace(u: fem.Function) -> PETSc.NullSpace:
    """The rigid body motions of the space of a displacement, orthonormalised; collective."""
    # Away from its axis an axisymmetric body resists the motions of the plane little: with all
    # three of them multigrid took a third of the iterations.
    motions = rigid_motions(u.function_space)
    vectors = [u.x.petsc_vec.duplicate() for _ in motions]
    for vector, motion in zip(vectors, motions, strict=True):
        vector.array_w[:] = np.asarray(motion)[: vector.getLocalSize()]
    return orthonormal(vectors)


def orthonormal(vectors: Sequence[PETSc.Vec]) -> PETSc.NullSpace:
    """The span of the vectors, which are orthonormalised and destroyed; collective."""
    basis: list[PETSc.Vec] = []
    for vector in vectors:
        for other in basis:
            vector.axpy(-vector.dot(other), other)
        vector.normalize()
        basis.append(vector)
    nullspace = PETSc.NullSpace().create(vectors=basis, comm=basis[0].getComm())
    for vector in basis:
        vector.destroy()
    return nullspace
