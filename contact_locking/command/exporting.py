"""The mesh of a study file as a file that all ranks of a run can read together."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from contact_locking.command import terminal
from contact_locking.mesh import mesh_export
from contact_locking.parameters import Parameters
from contact_locking.study import assembly


def export_mesh(parameters: Parameters, place: Path, comm: MPI.Intracomm) -> int:
    """Write the mesh as XDMF, also one from a file; returns the exit code; collective."""
    domain = assembly.mesh_of(parameters, comm)
    mesh_export.export(domain, place)
    for warning in domain.warnings:
        terminal.complain(f"warning: {domain.origin}: {warning}")
    if comm.rank == 0:
        print(f"{place}: written")
    return 0
