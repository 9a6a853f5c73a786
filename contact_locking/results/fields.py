"""The fields of a solution as a VTX file (ADIOS2, BP4) for ParaView."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

from dolfinx import fem, io
from mpi4py import MPI

from contact_locking.results.solution import Solution

FIELD_NAMES = (
    "displacement",
    "strain_norm",
    "locked",
    "elastic_stress",
    "locking_stress",
    "error_indicator",
    "contact_pressure",
    "tangential_traction",
    "smoothed_stress",
    "contact_state",
)

# After a failure without an error number the disk is taken to be full if fewer bytes are free.
_NO_ROOM_BYTES = 65_536


def discontinuous(solution: Solution) -> list[fem.Function]:
    """All fields as discontinuous P1 functions.

    All functions of a VTX file have one element, and discontinuous P1 contains P1 and P0.  The
    values are copied at the corners and not interpolated, so that 0 and 1 stay 0 and 1.  Raises
    InputError for an element of another degree than 1.
    """
    solution.element.require_linear("fields in a VTX file")
    spaces: dict[tuple[int, ...], fem.FunctionSpace] = {}
    copies = []
    for name in FIELD_NAMES:
        function = getattr(solution, name)
        shape = function.ufl_shape
        if shape not in spaces:
            element = ("DG", 1, shape) if shape else ("DG", 1)
            spaces[shape] = fem.functionspace(solution.domain.mesh, element)
        copy = fem.Function(spaces[shape], name=name)
        given, wanted = function.function_space.dofmap, copy.function_space.dofmap
        # A P0 function has one value in a cell, which every corner receives.
        values = function.x.array.reshape(-1, given.bs)[given.list]
        copy.x.array.reshape(-1, wanted.bs)[wanted.list] = values
        copies.append(copy)
    return copies


def size(functions: list[fem.Function], comm: MPI.Intracomm) -> int:
    """An upper bound of the bytes of the file: values, mesh, and ADIOS2's metadata of each rank."""
    mesh = functions[0].function_space.mesh
    cells = mesh.topology.index_map(mesh.topology.dim).size_global
    corners = cells * (mesh.topology.dim + 1)
    # A vector has 3 and a tensor 9 components in the file; a point has 3, a number and a ghost
    # mark.
    components = sum({0: 1, 1: 3, 2: 9}[len(f.ufl_shape)] for f in functions) + 3 + 2
    return int(8 * (components * corners + corners + cells) + 32_768 * (1 + comm.size))


def write(functions: list[fem.Function], path: Path, comm: MPI.Intracomm) -> None:
    """Write the functions to ``path``; collective.  Raises OSError where ADIOS2 fails."""
    file = Series(functions, path, comm)
    file.add(0.0)
    file.close()


class Series:
    """A file with the functions at several times; collective.

    Before each call of :meth:`add` the functions get their values.  The methods raise OSError where
    ADIOS2 fails.
    """

    def __init__(self, functions: list[fem.Function], path: Path, comm: MPI.Intracomm) -> None:
        self.functions, self._path = functions, path
        self._file = io.VTXWriter(comm, path, functions, engine="BP4")

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
        told = re.search(r"errno = (\d+)", str(error))
        full = shutil.disk_usage(path.parent).free < _NO_ROOM_BYTES
        number = int(told[1]) if told else errno.ENOSPC if full else errno.EIO
        raise OSError(number, os.strerror(number), str(path)) from error
