"""The record of a checkpoint: a JSON file beside the fields, with a digest of each file.

No field is opened before the record and the digests have been checked.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from contact_locking._version import __version__
from contact_locking.errors import InputError
from contact_locking.files.readable import file_digest
from contact_locking.results.names import CHECKPOINT, RECORD

# A change of the written files raises this number.
FORMAT = 7
# The names in the folder of a checkpoint.
FIELDS, MESH = "state.bp", "mesh"
_AGAIN = "save it again with contact-locking run --checkpoint"


class Record(BaseModel):
    """Identifies the problem and the mesh that a checkpoint belongs to.

    ``size`` has the dimension, the cells and the nodes of the mesh, the degree of the displacement,
    and 1 for a body of revolution; ``is_refined`` that of the mesh.  ``problem`` is the fingerprint
    of everything that defines the solution.  ``contacts`` is the number of contacts,
    ``strain_sets`` that of the sets of strains, and ``regularisations`` has one length for each
    contact.  ``travels`` are those of the tools.  ``step`` is about the step of a process, None for
    a problem without steps.  ``files`` has the digest of each file.
    """

    # JSON has no infinity, which is a text.
    model_config = {"frozen": True, "ser_json_inf_nan": "strings"}

    format: int = FORMAT
    version: str = __version__
    converged: bool
    n: float
    epsilon: float
    regularisations: tuple[float, ...]
    size: tuple[int, ...]
    is_refined: bool
    contacts: int
    strain_sets: int
    problem: str
    step: dict[str, Any] | None = None
    travels: tuple[float, ...] = ()
    files: dict[str, str] = {}


def save(record: Record, folder: Path) -> None:
    """Write the record of a checkpoint whose fields are complete.  Raises OSError."""
    for path in (folder / FIELDS).glob("profiling*"):
        path.unlink()  # timings of ADIOS2, which differ from run to run
    # The files of the fields, and of a refined mesh.
    paths = [*sorted((folder / FIELDS).iterdir()), *sorted(folder.glob(f"{MESH}.*"))]
    files = {path.name: file_digest(str(path)) for path in paths}
    whole = record.model_copy(update={"files": files})
    text = whole.model_dump_json(indent=2, exclude_none=True)
    (folder / RECORD).write_text(f"{text}\n", encoding="utf-8")


def locate(directory: str | Path) -> Path:
    """The folder of the checkpoint: ``directory`` itself, or in the folder of a run."""
    given = Path(directory)
    return given if (given / RECORD).is_file() else given / CHECKPOINT


def load(directory: str | Path) -> Record:
    """The record.

    Raises InputError for a missing, damaged or other record, and OSError if it cannot be read.
    """
    path = locate(directory) / RECORD
    if not path.is_file():
        raise InputError(f"there is no checkpoint in {directory}; {_AGAIN}")
    try:
        record = Record.model_validate_json(path.read_bytes())
    except ValidationError:
        record = None
    if record is None or record.format != FORMAT:
        raise InputError(
            f"{path} is damaged, or was saved by another version than contact_locking "
            f"{__version__}; {_AGAIN}"
        )
    return record


def load_fields(directory: str | Path) -> tuple[Record, Path]:
    """The record and the folder of the fields, whose files are complete and unchanged.

    Reads all files for their digests.  Raises as `load`.
    """
    record, folder = load(directory), locate(directory)
    for name, digest in record.files.items():
        path = (folder if Path(name).stem == MESH else folder / FIELDS) / Path(name).name
        if not path.is_file() or file_digest(str(path)) != digest:
            raise InputError(f"{path} is missing or damaged; {_AGAIN}")
    return record, folder / FIELDS
