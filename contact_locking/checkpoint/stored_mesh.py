"""The refined mesh of a checkpoint; the mesh of a study file is made again from the study file."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from contact_locking.checkpoint import record as records
from contact_locking.checkpoint.stored import expect
from contact_locking.errors import InputError
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.whole_mesh import WholeMesh, spread
from contact_locking.parallel import on_root
from contact_locking.plain_text import defect


def refined_mesh(directory: str | Path, comm: MPI.Intracomm) -> Domain | None:
    """The refined mesh that a checkpoint belongs to; None for the mesh of a study; collective.

    Raises InputError if the checkpoint is missing, damaged or of another format, and
    ContactLockingError if the library is missing.
    """
    expect(directory, comm)
    held: list[WholeMesh] = []

    def load() -> bool:
        record, _ = records.load_fields(directory)
        if record.mesh.get("refined"):
            held.append(_read(records.locate(directory)))
        return bool(held)

    if not on_root(comm, load):
        return None
    return spread(held[0] if held else None, comm)


def _read(folder: Path) -> WholeMesh:
    try:
        return WholeMesh.load(folder, records.MESH)
    except (ValueError, KeyError, TypeError, IndexError, OSError) as error:
        raise InputError(f"the mesh in {folder} is damaged ({defect(error)})") from error
