"""Every difference between DOLFINx 0.9, 0.10 and 0.11 that this package meets, and nothing else.

PETSc and the libraries around it come with them.
"""

from __future__ import annotations

import ctypes
import functools
import importlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx import mesh as dmesh
from petsc4py import PETSc

# From Open MPI's first tag of a nonblocking collective, -27, to beyond the last in question, -51.
_TAGS = 32


def interpolation_expression(expr: Any, space: Any) -> fem.Expression:
    """``expr`` as DOLFINx interpolates it into ``space``."""
    points = space.element.interpolation_points
    return fem.Expression(expr, points() if callable(points) else points)


def cell_nodes(mesh: dmesh.Mesh) -> npt.NDArray[np.int32]:
    """Geometry nodes (k, nodes per cell); DOLFINx 0.11 has one array for each type of cell."""
    dofmaps = getattr(mesh.geometry, "dofmaps", None)
    return dofmaps[0] if isinstance(dofmaps, list) else mesh.geometry.dofmap


def entities_to_geometry(mesh: dmesh.Mesh, dim: int, entities: Any) -> npt.NDArray[np.int32]:
    """Geometry nodes (k, nodes per entity); DOLFINx 0.9 divides by zero if there are none."""
    if len(entities) == 0:
        return np.empty((0, dim + 1), dtype=np.int32)
    mesh.topology.create_connectivity(dim, mesh.topology.dim)
    return dmesh.entities_to_geometry(mesh, dim, entities)


def collapse(component: Any) -> tuple[fem.FunctionSpace, npt.NDArray[np.int32]]:
    """The space of a component and its dofs in the whole; DOLFINx 0.11 nests the latter."""
    space, dofs = component.collapse()
    return space, np.asarray(dofs, dtype=np.int32).reshape(-1)


def point_owners(data: Any) -> npt.NDArray[np.int32]:
    """The ranks that own the points of interpolation data, -1 where none does."""
    owners = data.src_owner
    return np.asarray(owners() if callable(owners) else owners)


def checkpoint_library() -> Any:
    """adios4dolfinx, or io4dolfinx, as its successor is called; ImportError where neither works."""
    try:
        return importlib.import_module("adios4dolfinx")
    except ImportError as error:
        try:
            importlib.import_module("adios2")  # io4dolfinx misses it only when it writes
            return importlib.import_module("io4dolfinx")
        except ImportError:
            raise error from None


def petsc_option_used(name: str) -> bool:
    """Whether PETSc has asked for an option of its database; petsc4py 3.22 does not tell."""
    if hasattr(PETSc.Options, "used"):
        return bool(PETSc.Options().used(name))
    used = ctypes.c_int(0)
    library = ctypes.CDLL(PETSc.__file__)  # it brings PETSc's own library along
    library.PetscOptionsUsed(None, name.encode(), ctypes.byref(used))
    return bool(used.value)


@functools.cache
def block_jacobi_follows_its_matrix() -> bool:
    """Whether PETSc inverts the diagonal blocks anew when the matrix changes; 3.25 does not."""
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
    for item in (preconditioner, matrix, right, inverse):
        item.destroy()
    return follows


def prepare_communicator(comm: Any) -> None:
    """Keep Open MPI up to 5.0.10 from hanging in the checkpoint library; collective.

    MPI_Dist_graph_create exchanges messages by tags that the nonblocking collectives of the same
    communicator come past too, once (https://github.com/open-mpi/ompi/issues/13918): let them.
    """
    for _ in range(_TAGS):
        comm.Ibarrier().Wait()


def save_function(path: Path, function: fem.Function, name: str) -> None:
    """Add a function to a file, in the order of the cells as the mesh was made; collective."""
    # The words that both libraries share.
    checkpoint_library().write_function_on_input_mesh(path, function, time=0.0, name=name)


def load_function(path: Path, function: fem.Function, name: str) -> None:
    """Fill a function from a file, on the same mesh however it is distributed; collective."""
    checkpoint_library().read_function(path, function, time=0.0, name=name)
