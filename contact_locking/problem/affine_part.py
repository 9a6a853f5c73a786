"""The affine displacements among the quadratic ones, on which multigrid goes on."""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc
from petsc4py import PETSc

from contact_locking.supports.conditions import Constraints, block_diagonal


def near_nullspace(u: fem.Function) -> PETSc.NullSpace:
    """The rigid body motions of the space of a displacement, orthonormal; collective."""
    # Away from its axis an axisymmetric body resists the motions of the plane little: with all
    # three of them multigrid took a third of the iterations.
    return _rigid_motions(u.x.petsc_vec.duplicate(), u.function_space)


def _rigid_motions(vector: PETSc.Vec, space: fem.FunctionSpace) -> PETSc.NullSpace:
    """Those of a space as vectors like the given one, which is destroyed; collective."""
    points = space.tabulate_dof_coordinates()[: space.dofmap.index_map.size_local]
    vector.array_w[:] = points[:, : vector.getBlockSize()].reshape(-1)
    nullspace = PETSc.NullSpace().createRigidBody(vector)
    vector.destroy()
    return nullspace


def affine_part(
    space: fem.FunctionSpace, constraints: Constraints
) -> tuple[PETSc.Mat, PETSc.NullSpace]:
    """``P``, from values at the corners of cells to nodal values, and the rigid motions there.

    With ``F`` the projection of a node's displacement onto the directions that the conditions leave
    free, the value at the midpoint m of an edge between the corners 1 and 2 is
    ``F_m (F_1 v_1 + F_2 v_2)/2``, and ``v_1`` at the corner 1.  So ``P^T A P`` has the identity for
    what the conditions hold wherever A has.  ``space`` has the quadratic displacements.
    Collective.
    """
    dim = space.dofmap.index_map_bs
    affine = fem.functionspace(space.mesh, ("P", 1, (dim,)))
    plain = petsc.interpolation_matrix(affine, space)
    plain.assemble()
    count = len(space.tabulate_dof_coordinates())
    # The projections (n, d, d) at local nodes, ghosts included.
    units = (np.tile(row, count) for row in np.eye(dim))
    free = np.stack([constraints.free_part(unit).reshape(-1, dim) for unit in units], axis=2)
    corners = range(affine.dofmap.list.shape[1])
    at_corner = [space.dofmap.dof_layout.entity_dofs(0, corner)[0] for corner in corners]
    nodes = space.dofmap.list[:, at_corner].reshape(-1)
    free_there = np.zeros((len(affine.tabulate_dof_coordinates()), dim, dim))
    free_there[affine.dofmap.list.reshape(-1)] = free[nodes]
    # F at midpoints, and nothing at corners, whose rows are those of the interpolation.
    free[nodes] = 0.0
    left, right = (
        block_diagonal(blocks[: each.dofmap.index_map.size_local], space.mesh.comm)
        for blocks, each in ((free, space), (free_there, affine))
    )
    scaled = plain.matMult(right)
    prolongation = left.matMult(scaled)
    is_corner = plain.createVecLeft()
    is_corner.array_w[:] = np.repeat(np.isin(np.arange(count), nodes), dim)[
        : len(is_corner.array_r)
    ]
    plain.diagonalScale(is_corner)
    prolongation.axpy(1.0, plain, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    prolongation.setBlockSizes(dim, dim)
    for petsc_object in (plain, left, right, scaled, is_corner):
        petsc_object.destroy()
    return prolongation, _rigid_motions(prolongation.createVecRight(), affine)
