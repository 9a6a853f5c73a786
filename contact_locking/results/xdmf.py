"""The fields of a solution as an XDMF file with its HDF5 data, for tools that do not read VTX."""

from __future__ import annotations

from pathlib import Path

from dolfinx import fem, io
from mpi4py import MPI

from contact_locking.results.fields import FIELD_NAMES
from contact_locking.results.solution import Solution


def write(solution: Solution, path: Path, comm: MPI.Intracomm) -> None:
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
