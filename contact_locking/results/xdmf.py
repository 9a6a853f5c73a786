"""The fields of a solution as an XDMF file with its HDF5 data, for tools that do not read VTX."""

from __future__ import annotations

from pathlib import Path

from dolfinx import io
from mpi4py import MPI

from contact_locking.results.fields import FIELD_NAMES
from contact_locking.results.solution import Solution


def write(solution: Solution, path: Path, comm: MPI.Intracomm) -> None:
    """Write all fields to ``path`` and to the file beside it that ends with .h5; collective.

    Fields of the body are constant in each cell, and fields on Gamma_C are linear.  Raises
    InputError for an element of another degree than 1, and OSError where HDF5 fails.
    """
    solution.element.require_linear("fields in an XDMF file")
    try:
        with io.XDMFFile(comm, path, "w") as file:
            file.write_mesh(solution.domain.mesh)
            for name in FIELD_NAMES:
                function = getattr(solution, name)
                before, function.name = function.name, name
                file.write_function(function, 0.0)
                function.name = before
    except RuntimeError as error:
        raise OSError(f"HDF5 cannot write {path.name}: {error}") from error
