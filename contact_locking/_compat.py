"""Every difference between DOLFINx 0.9, 0.10 and 0.11 that concerns this package, and nothing else.

The differences include those of the PETSc and the checkpoint library that belong to each version.
"""

from __future__ import annotations

import ctypes
import functools
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from dolfinx.cpp.mesh import cell_entity_type, cell_num_vertices
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray


def interpolation_points(space: Any) -> FloatArray:
    """The points (k, d) of the reference cell at which ``space`` interpolates."""
    points = space.element.interpolation_points
    return points() if callable(points) else points


def of_mesh(value: Any, mesh: dmesh.Mesh) -> Any:
    """A UFL expression that has data on the mesh.

    DOLFINx 0.11 interpolates no expression of numbers alone.
    """
    has_mesh = ufl.domain.extract_unique_domain(value) is not None
    return value if has_mesh else fem.Constant(mesh, 1.0) * value


def coordinate_map(mesh: dmesh.Mesh) -> Any:
    """The map from the reference cell; DOLFINx 0.11 has one for each type of cell."""
    maps = getattr(mesh.geometry, "cmaps", None)
    return maps[0] if isinstance(maps, list) else mesh.geometry.cmap


def cell_nodes(mesh: dmesh.Mesh) -> IndexArray:
    """Geometry nodes (k, nodes per cell); DOLFINx 0.11 has one array for each type of cell."""
    dofmaps = getattr(mesh.geometry, "dofmaps", None)
    return dofmaps[0] if isinstance(dofmaps, list) else mesh.geometry.dofmap


def cell_corners(mesh: dmesh.Mesh) -> IndexArray:
    """The geometry nodes (k, corners per cell) at corners, which come first in each cell."""
    return cell_nodes(mesh)[:, : cell_num_vertices(mesh.topology.cell_type)]


def entities_to_geometry(mesh: dmesh.Mesh, dim: int, entities: Any) -> IndexArray:
    """The geometry nodes (k, corners per entity) at the corners of k entities.

    DOLFINx 0.9 divides by zero if there is no entity.
    """
    count = cell_num_vertices(cell_entity_type(mesh.topology.cell_type, dim, 0))
    if len(entities) == 0:
        return np.empty((0, count), dtype=np.int32)
    mesh.topology.create_connectivity(dim, mesh.topology.dim)
    return dmesh.entities_to_geometry(mesh, dim, entities)[:, :count]


def collapse(component: Any) -> tuple[fem.FunctionSpace, IndexArray]:
    """The space of a component, and the dofs of the component in the whole space.

    DOLFINx 0.11 returns the dofs in a list of arrays.
    """
    space, dofs = component.collapse()
    return space, np.asarray(dofs, dtype=np.int32).reshape(-1)


def point_owners(data: Any) -> IndexArray:
    """The ranks that own the points of interpolation data; -1 where no rank owns the point."""
    owners = data.src_owner
    return np.asarray(owners() if callable(owners) else owners)


def petsc_option_used(name: str) -> bool:
    """Whether PETSc has asked for an option of its database.

    petsc4py 3.22 has no function for this question, but PETSc's library has one.
    """
    if hasattr(PETSc.Options, "used"):
        return bool(PETSc.Options().used(name))
    used = ctypes.c_int(0)
    library = ctypes.CDLL(PETSc.__file__)  # loads PETSc's library as well
    library.PetscOptionsUsed(None, name.encode(), ctypes.byref(used))
    return bool(used.value)


@functools.cache
def block_jacobi_follows_its_matrix() -> bool:
    """Whether PETSc inverts the diagonal blocks again when the matrix changes; 3.25 does not."""
    matrix = PETSc.Mat().createAIJ((1, 1), nnz=1, comm=PETSc.COMM_SELF)
    preconditioner = PETSc.PC().create(PETSc.COMM_SELF)
    preconditioner.setType(PETSc.PC.Type.PBJACOBI)
    right, inverse = matrix.createVecs()
    right.set(1.0)
    for value in (1.0, 2.0):
        matrix.setValue(0, 0, value)
        matrix.assemble()
        preconditioner.setOperators(matrix)
        preconditioner.setUp()
        preconditioner.apply(right, inverse)
    follows = bool(inverse.array_r[0] == 0.5)
    for petsc_object in (preconditioner, matrix, right, inverse):
        petsc_object.destroy()
    return follows
