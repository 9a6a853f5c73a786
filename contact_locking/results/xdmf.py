"""The fields of a solution as an XDMF file with its HDF5 data, for tools that do not read VTX."""

from __future__ import annotations

from pathlib import Path

import basix.ufl
import dolfinx
import numpy as np
import ufl
from dolfinx import default_real_type, fem, io
from dolfinx import mesh as dmesh
from mpi4py import MPI

from contact_locking import _compat
from contact_locking.arrays import IndexArray
from contact_locking.results.fields import FIELD_NAMES
from contact_locking.results.solution import Solution


def write(solution: Solution, path: Path, comm: MPI.Intracomm) -> None:
    """Write all fields to ``path`` and to the file beside it that ends with .h5; collective.

    Fields of strains and stresses are constant in each cell, and the others have the degree of the
    displacements.  Raises OSError where HDF5 fails.
    """
    mesh, degree = solution.domain.mesh, solution.element.degree
    # An XDMF file has functions of the degree of its mesh, and cell by cell.
    target = mesh if degree == 1 else quadratic(solution.displacement.function_space)
    try:
        with io.XDMFFile(comm, path, "w") as file:
            file.write_mesh(target)
            for name in FIELD_NAMES:
                function = getattr(solution, name)
                if function is not None:
                    jumps = function.function_space.element.basix_element.discontinuous
                    element = ("DG", 0) if jumps else ("P", degree)
                    space = fem.functionspace(mesh, (*element, function.ufl_shape))
                    copy = fem.Function(space, name=name)
                    copy.interpolate(function)
                    if target is not mesh:
                        copy = on_the_same_cells(copy, target)
                    file.write_function(copy, 0.0)
    except RuntimeError as error:
        raise OSError(f"HDF5 cannot write {path.name}: {error}") from error


def quadratic(space: fem.FunctionSpace) -> dolfinx.mesh.Mesh:
    """A mesh with the nodes of a space of degree 2 and the cells of its mesh; collective.

    Each rank keeps its cells, and numbers them anew.
    """
    mesh, index_map = space.mesh, space.dofmap.index_map
    dim = mesh.topology.dim
    nodes = space.dofmap.list[: mesh.topology.index_map(dim).size_local]
    flat = np.ascontiguousarray(nodes, dtype=np.int32).reshape(-1)
    element = basix.ufl.element(
        "Lagrange", mesh.basix_cell().name, 2, shape=(dim,), dtype=default_real_type
    )
    return dmesh.create_mesh(
        comm=mesh.comm,
        cells=index_map.local_to_global(flat).reshape(nodes.shape),
        x=space.tabulate_dof_coordinates()[: index_map.size_local, :dim],
        e=ufl.Mesh(element),
        partitioner=_compat.no_redistribution,
    )


def on_the_same_cells(function: fem.Function, mesh: dolfinx.mesh.Mesh) -> fem.Function:
    """The function on a mesh of `quadratic`."""
    given = function.function_space
    space = fem.functionspace(mesh, given.ufl_element())
    copy = fem.Function(space, name=function.name)
    cells = _old_cells(given.mesh, mesh)
    values = function.x.array.reshape(-1, given.dofmap.bs)[given.dofmap.list[cells]]
    copy.x.array.reshape(-1, given.dofmap.bs)[space.dofmap.list[: len(cells)]] = values
    copy.x.scatter_forward()
    return copy


def _old_cells(old: dolfinx.mesh.Mesh, new: dolfinx.mesh.Mesh) -> IndexArray:
    """The owned cell (k,) of the old mesh for each owned cell of the new mesh; collective."""
    count = old.topology.index_map(old.topology.dim).size_local
    first = old.comm.scan(count) - count
    return np.asarray(new.topology.original_cell_index[:count] - first, dtype=np.int32)
