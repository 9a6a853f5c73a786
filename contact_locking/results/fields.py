"""The fields of a solution as a VTX file (ADIOS2) for ParaView, and as XDMF for other tools."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem, io
from mpi4py import MPI

from contact_locking.fem import compiled
from contact_locking.results.solution import Solution

FIELD_NAMES = (
    "displacement",
    "strain_norm",
    "locked",
    "elastic_stress",
    "locking_stress",
    "von_mises",
    "error_indicator",
    "contact_pressure",
    "tangential_traction",
    "smoothed_stress",
    "contact_state",
)

# To write a file of BP4, ADIOS2 needs some three times its bytes in memory.  BP5 takes two thirds
# of that, and ParaView reads BP5 from version 5.12 on only, so that smaller files are BP4.
_LARGEST_BP4 = 2**29

# After a failure without an error number the disk is taken to be full if fewer bytes are free.
_NO_ROOM_BYTES = 65_536


def discontinuous(solution: Solution) -> list[fem.Function]:
    """All fields as discontinuous functions of the displacement's degree.

    All functions of a VTX file have one element, and these functions contain the displacements and
    the strains.  Values that are constant in a cell are copied.  Of strains that vary in a cell the
    norm is |eps(u)| at each node, unless the body is axisymmetric.  The other fields of the space
    of strains are extended to the nodes as the functions that they are, except ``locked``, which is
    that of the point beside a node and stays between 0 and 1.
    """
    degree, mesh = solution.element.degree, solution.domain.mesh
    spaces: dict[tuple[int, ...], fem.FunctionSpace] = {}
    copies = []
    for name in FIELD_NAMES:
        function = getattr(solution, name)
        if function is None:
            continue
        shape = function.ufl_shape
        if shape not in spaces:
            element = ("DG", degree, shape) if shape else ("DG", degree)
            spaces[shape] = fem.functionspace(mesh, element)
        copy = fem.Function(spaces[shape], name=name)
        _fill(copy, function, name, solution)
        copies.append(copy)
    return copies


def _fill(copy: fem.Function, function: fem.Function, name: str, solution: Solution) -> None:
    """Give a discontinuous function the values of a field; collective."""
    space = copy.function_space
    source, target = function.function_space.dofmap, space.dofmap
    values = function.x.array.reshape(-1, source.bs)[source.list]
    # On the axis of an axisymmetric body the hoop strain is no number at a node.
    kinematics = solution.element.kinematics
    element, is_constant = solution.element, values.shape[1] == 1
    is_nodal = not function.function_space.element.basix_element.discontinuous
    # Whether there is a point of the strains beside each node.
    each = source.list.shape[1] == target.list.shape[1]
    varies = element.strain_degree > 0 and not kinematics.axisymmetric
    if name == "strain_norm" and varies:
        eps = kinematics.strain(solution.displacement)
        norm = ufl.sqrt(ufl.inner(eps, eps))
        copy.interpolate(compiled.interpolation(norm, space))
    elif is_constant or is_nodal or (name == "locked" and each):
        # A constant has one value in a cell, which every node receives.
        copy.x.array.reshape(-1, target.bs)[target.list] = values
    else:
        copy.interpolate(function)
        if name == "locked":
            copy.x.array[:] = np.clip(np.round(copy.x.array, 9), 0.0, 1.0)


def size(functions: list[fem.Function], comm: MPI.Intracomm) -> int:
    """An upper bound of the bytes of the file: values, mesh, and ADIOS2's metadata of each rank."""
    space = functions[0].function_space
    mesh, in_cell = space.mesh, space.dofmap.list.shape[1]
    cells = mesh.topology.index_map(mesh.topology.dim).size_global
    nodes = cells * in_cell
    # A vector has 3 and a tensor 9 components in the file; a point has 3, a number and a ghost
    # mark.
    components = sum({0: 1, 1: 3, 2: 9}[len(f.ufl_shape)] for f in functions) + 3 + 2
    return int(8 * (components * nodes + nodes + cells) + 32_768 * (1 + comm.size))


class Series:
    """A file with the functions at several times; collective.

    Before each call of :meth:`add` the functions get their values.  The methods raise OSError where
    ADIOS2 fails.
    """

    def __init__(self, functions: list[fem.Function], path: Path, comm: MPI.Intracomm) -> None:
        self.functions, self._path = functions, path
        engine = "BP4" if size(functions, comm) <= _LARGEST_BP4 else "BP5"
        self._file = io.VTXWriter(comm, path, functions, engine=engine)

    def add(self, time: float) -> None:
        """Write the present values for a time."""
        with _explained(self._file, self._path):
            self._file.write(time)

    def close(self) -> None:
        """Complete the file."""
        with _explained(self._file, self._path):
            self._file.close()


@contextlib.contextmanager
def _explained(file: io.VTXWriter, path: Path) -> Iterator[None]:
    """Raise an OSError in place of the error of ADIOS2."""
    try:
        yield
    except RuntimeError as error:
        # The destructor of ADIOS2 would write again, and an exception in a destructor ends the
        # process.  One more reference to the file prevents the call of the destructor.
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(file))
        number_text = re.search(r"errno = (\d+)", str(error))
        full = shutil.disk_usage(path.parent).free < _NO_ROOM_BYTES
        number = int(number_text[1]) if number_text else errno.ENOSPC if full else errno.EIO
        raise OSError(number, os.strerror(number), str(path)) from error


def write_xdmf(solution: Solution, path: Path, comm: MPI.Intracomm) -> None:
    """Write all fields to ``path`` and to the file beside it that ends with .h5; collective.

    Fields of strains and stresses are constant in each cell, and the others have the values at the
    corners of the cells.  Raises OSError where HDF5 fails.
    """
    mesh = solution.domain.mesh
    try:
        with io.XDMFFile(comm, path, "w") as file:
            file.write_mesh(mesh)
            for name in FIELD_NAMES:
                function = getattr(solution, name)
                if function is not None:
                    jumps = function.function_space.element.basix_element.discontinuous
                    element = ("DG", 0) if jumps else ("P", 1)
                    space = fem.functionspace(mesh, (*element, function.ufl_shape))
                    copy = fem.Function(space, name=name)
                    copy.interpolate(function)
                    file.write_function(copy, 0.0)
    except RuntimeError as error:
        raise OSError(f"HDF5 cannot write {path.name}: {error}") from error
