"""The record of a checkpoint: a JSON file beside the fields, with a digest of each file.

No field is opened before the record and the digests have been checked.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from contact_locking import study_file
from contact_locking._version import __version__
from contact_locking.errors import InputError
from contact_locking.results.names import CHECKPOINT, RECORD

# A change of the written files raises this number.
FORMAT = 6
# The names in the folder of a checkpoint.
FIELDS, MESH = "state.bp", "mesh"
_AGAIN = "save it again with contact-locking run --checkpoint"


class _Stamp(BaseModel):
    """The entries of every format; JSON has no infinity, which is a text."""

    model_config = {"frozen": True, "ser_json_inf_nan": "strings"}

    format: int = FORMAT
    version: str = __version__


class Record(_Stamp):
    """Identifies the problem and the mesh that a checkpoint belongs to.

    ``mesh`` holds the parameters of the mesh, or the digest of the mesh file; ``problem`` is the
    fingerprint of everything that defines the solution.  ``degree`` is the degree of the
    displacement.  ``contacts`` is the number of contacts, ``strain_sets`` that of the sets of
    strains, and ``regularisations`` has one length for each contact.  ``travels`` are those of the
    tools.  ``step`` is about the step of a process, None for a problem without steps.  ``files``
    has the size and the digest of each file.
    """

    converged: bool
    n: float
    epsilon: float
    regularisations: tuple[float, ...]
    dimension: int
    degree: int
    cells: int
    nodes: int
    contacts: int
    strain_sets: int
    mesh: dict[str, Any]
    problem: str
    step: dict[str, Any] | None = None
    travels: tuple[float, ...] = ()
    files: dict[str, tuple[int, str]] = {}


def save(record: Record, folder: Path) -> None:
    """Write the record of a checkpoint whose fields are complete.  Raises OSError."""
    for path in (folder / FIELDS).glob("profiling*"):
        path.unlink()  # timings of ADIOS2, which differ from run to run
    # The files of the fields, and of a refined mesh.
    paths = [*sorted((folder / FIELDS).iterdir()), *sorted(folder.glob(f"{MESH}.*"))]
    files = {path.name: (path.stat().st_size, study_file.file_digest(str(path))) for path in paths}
    whole = record.model_copy(update={"files": files})
    text = whole.model_dump_json(indent=2, exclude_none=True)
    (folder / RECORD).write_text(f"{text}\n", encoding="utf-8")


def locate(directory: str | Path) -> Path:
    """The folder of the checkpoint: ``directory`` itself, or in the folder of a run."""
    given = Path(directory)
    return given if (given / RECORD).is_file() else given / CHECKPOINT


def load(directory: str | Path) -> Record:
    """The record.

    Raises InputError for a missing or damaged record, and OSError if the file cannot be read.
    """
    path = locate(directory) / RECORD
    if not Path(directory).is_dir():
        raise InputError(f"there is no folder {directory} to restart from")
    if not path.is_file():
        raise InputError(f"there is no checkpoint in {directory}; {_AGAIN}")
    text = path.read_bytes()
    try:
        stamp = _Stamp.model_validate_json(text)
        if stamp.format == FORMAT:
            return Record.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        told = ": ".join([*map(str, first["loc"]), first["msg"]])
        raise InputError(f"{path} is damaged ({told}); {_AGAIN}") from error
    raise InputError(
        f"{path.parent} was saved by contact_locking {stamp.version} in format {stamp.format}, and "
        f"contact_locking {__version__} reads format {FORMAT}: use the version that saved it, or "
        f"{_AGAIN}"
    )


def load_fields(directory: str | Path) -> tuple[Record, Path]:
    """The record and the folder of the fields, whose files are complete and unchanged.

    Reads all files for their digests.  Raises as `load`.
    """
    record, folder = load(directory), locate(directory)
    for name, (size, digest) in record.files.items():
        inside = folder if Path(name).stem == MESH else folder / FIELDS
        path = inside / Path(name).name
        if not path.is_file():
            raise InputError(f"the checkpoint is incomplete: there is no {path}; {_AGAIN}")
        found = path.stat().st_size
        if found != size:
            raise InputError(f"{path} is damaged: it has {found} bytes, not {size}; {_AGAIN}")
        if study_file.file_digest(str(path)) != digest:
            raise InputError(f"{path} is damaged: its content has changed; {_AGAIN}")
    return record, folder / FIELDS
