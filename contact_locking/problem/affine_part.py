"""The affine displacements among the quadratic ones, on which multigrid goes on."""

from __future__ import annotations

import basix
import numpy as np
from dolfinx import fem
from petsc4py import PETSc
from scipy.sparse import bsr_matrix

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.supports.conditions import Constraints


def near_nullspace(u: fem.Function) -> PETSc.NullSpace:
    """The rigid body motions of the space of a displacement, orthonormal; collective."""
    # Away from its axis an axisymmetric body resists the motions of the plane little: with all
    # three of them multigrid took a third of the iterations.
    space, vector = u.function_space, u.x.petsc_vec.duplicate()
    points = space.tabulate_dof_coordinates()[: space.dofmap.index_map.size_local]
    return _rigid_motions(vector, points)


def _rigid_motions(vector: PETSc.Vec, points: FloatArray) -> PETSc.NullSpace:
    """Those of points (k, 3) as vectors like the given one, which is destroyed; collective."""
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
    what the conditions hold wherever A has.  ``space`` has the quadratic displacements; the corners
    are numbered rank by rank in the order of their nodes.  Collective.
    """
    dim, index_map = space.dofmap.index_map_bs, space.dofmap.index_map
    corners, edges = _nodes(space)
    corners = corners[corners < index_map.size_local]
    edges = edges[edges[:, 0] < index_map.size_local]
    middles, ends = edges[:, 0], edges[:, 1:]
    numbers = _numbers(space, corners)
    free = _free_parts(space, constraints)
    # One block at a corner, and one for each end of an edge.
    lengths = np.ones(index_map.size_local, dtype=np.int32)
    lengths[middles] = 2
    rows = np.concatenate([corners, np.repeat(middles, 2)])
    columns = np.concatenate([corners, ends.reshape(-1)])
    shares = np.einsum("mij,mejk->meik", free[middles], free[ends]) / 2
    units = np.broadcast_to(np.eye(dim), (len(corners), dim, dim))
    blocks = np.concatenate([units, shares.reshape(-1, dim, dim)])
    order = np.argsort(rows, kind="stable")
    total = dim * space.mesh.comm.allreduce(len(corners))
    local = bsr_matrix(
        (blocks[order], numbers[columns][order], np.append(0, np.cumsum(lengths))),
        shape=(dim * len(lengths), total),
    ).tocsr()
    prolongation = PETSc.Mat().createAIJ(
        ((local.shape[0], None), (dim * len(corners), None)),
        bsize=dim,
        csr=(local.indptr.astype(PETSc.IntType), local.indices.astype(PETSc.IntType), local.data),
        comm=space.mesh.comm,
    )
    points = space.tabulate_dof_coordinates()[corners]
    return prolongation, _rigid_motions(prolongation.createVecRight(), points)


def _nodes(space: fem.FunctionSpace) -> tuple[IndexArray, IndexArray]:
    """The local nodes at corners (c,), and of each edge that in the middle and both ends (m, 3)."""
    layout = space.dofmap.dof_layout
    topology = basix.topology(basix.CellType[space.mesh.topology.cell_name()])
    at_corner = [layout.entity_dofs(0, corner)[0] for corner in range(len(topology[0]))]
    local = [
        [*layout.entity_dofs(1, number), *(at_corner[corner] for corner in corners)]
        for number, corners in enumerate(topology[1])
    ]
    edges = space.dofmap.list[:, np.array(local)].reshape(-1, 3)
    edges = edges[np.unique(edges[:, 0], return_index=True)[1]]
    return np.unique(space.dofmap.list[:, at_corner]), edges


def _numbers(space: fem.FunctionSpace, corners: IndexArray) -> IndexArray:
    """The global numbers of corners at all local nodes, ghosts included; collective.

    ``corners`` are owned.  Other nodes have no number.
    """
    comm, dim = space.mesh.comm, space.dofmap.index_map_bs
    first = sum(comm.allgather(len(corners))[: comm.rank])
    field = fem.Function(space)
    # Doubles hold integers up to 9e15.
    field.x.array[dim * corners] = first + np.arange(len(corners))
    field.x.scatter_forward()
    return np.asarray(field.x.array[::dim].astype(PETSc.IntType))


def _free_parts(space: fem.FunctionSpace, constraints: Constraints) -> FloatArray:
    """``F`` (n, d, d) at the n local nodes, ghosts included."""
    dim, index_map = space.dofmap.index_map_bs, space.dofmap.index_map
    count = index_map.size_local + index_map.num_ghosts
    units = (np.tile(row, count) for row in np.eye(dim))
    return np.stack([constraints.free_part(unit).reshape(count, dim) for unit in units], axis=2)
