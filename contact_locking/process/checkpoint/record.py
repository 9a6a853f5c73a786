"""The record of a checkpoint: a JSON file beside the fields, with a digest of each file.

No field is opened before the record and the digests have been checked.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from contact_locking import study_file
from contact_locking._version import __version__
from contact_locking.errors import InputError
from contact_locking.plain_text import defect
from contact_locking.results.names import CHECKPOINT

# A change of the written files raises this number.
FORMAT = 5
# The folder of a checkpoint in the folder of a run, and the names in this folder.
NAME, RECORD, FIELDS, MESH = CHECKPOINT, "record.json", "state.bp", "mesh"
_AGAIN = "save it again with contact-locking run --checkpoint"


@dataclass(frozen=True)
class Record:
    """Identifies the problem and the mesh that a checkpoint belongs to.

    ``mesh`` holds the parameters of the mesh, or the digest of the mesh file; ``problem`` is the
    fingerprint of everything that defines the solution.  ``degree`` is the degree of the
    displacement, and ``limit_at`` names the points of the strains.  ``contacts`` is the number of
    contacts, ``strain_sets`` that of the sets of strains, and ``regularisations`` has one length
    for each contact.  ``travels`` are those of the tools.  ``step`` is about the step of a
    process, None for a problem without steps.
    """

    version: str
    converged: bool
    n: float
    epsilon: float
    regularisations: tuple[float, ...]
    dimension: int
    degree: int
    limit_at: str
    cells: int
    nodes: int
    contacts: int
    strain_sets: int
    mesh: dict[str, Any]
    problem: str
    step: dict[str, Any] | None = None
    travels: tuple[float, ...] = ()


def save(record: Record, folder: Path) -> None:
    """Write the record of a checkpoint whose fields are complete.  Raises OSError."""
    for path in (folder / FIELDS).glob("profiling*"):
        path.unlink()  # timings of ADIOS2, which differ from run to run
    # The files of the fields, and of a refined mesh.
    files = [*sorted((folder / FIELDS).iterdir()), *sorted(folder.glob(f"{MESH}.*"))]
    data = asdict(record) | {
        "format": FORMAT,
        # JSON has no infinity.
        "n": str(record.n),
        "epsilon": str(record.epsilon),
        "regularisations": [str(value) for value in record.regularisations],
        "files": {path.name: _seen(path) for path in files},
    }
    if record.step is None:
        del data["step"]
    (folder / RECORD).write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")


def locate(directory: str | Path) -> Path:
    """The folder of the checkpoint: ``directory`` itself, or in the folder of a run."""
    given = Path(directory)
    return given if (given / RECORD).is_file() else given / NAME


def load(directory: str | Path) -> tuple[Record, dict[str, tuple[int, str]]]:
    """The record, and for each file of the fields its size and digest.

    Raises InputError for a missing or damaged record, and OSError if the file cannot be read.
    """
    folder = locate(directory)
    if not Path(directory).is_dir():
        raise InputError(f"there is no folder {directory} to restart from")
    if not (folder / RECORD).is_file():
        raise InputError(f"there is no checkpoint in {directory}; {_AGAIN}")
    try:
        data = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        if data["format"] != FORMAT:
            raise InputError(
                f"{folder} was saved by contact_locking {data['version']} in format "
                f"{data['format']}, and contact_locking {__version__} reads format {FORMAT}: "
                f"use the version that saved it, or {_AGAIN}"
            )
        files = {name: (int(size), str(sha)) for name, (size, sha) in data["files"].items()}
        return _record(data), files
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(f"{folder / RECORD} is damaged ({defect(error)}); {_AGAIN}") from error


def load_fields(directory: str | Path) -> tuple[Record, Path]:
    """The record and the folder of the fields, whose files are complete and unchanged.

    Reads all files for their digests.  Raises as `load`.
    """
    record, files = load(directory)
    folder = locate(directory)
    for name, (size, digest) in files.items():
        inside = folder if Path(name).stem == MESH else folder / FIELDS
        _check_file(inside / Path(name).name, size, digest)
    return record, folder / FIELDS


def _record(data: Mapping[str, Any]) -> Record:
    names = ("dimension", "degree", "cells", "nodes", "contacts")
    numbers = {name: int(data[name]) for name in names}
    return Record(
        version=str(data["version"]),
        converged=bool(data["converged"]),
        n=float(data["n"]),
        epsilon=float(data["epsilon"]),
        regularisations=tuple(float(value) for value in data["regularisations"]),
        limit_at=str(data["limit_at"]),
        mesh=dict(data["mesh"]),
        problem=str(data["problem"]),
        step=dict(data["step"]) if "step" in data else None,
        # Older versions know the ball alone.
        strain_sets=int(data.get("strain_sets", 1)),
        travels=tuple(float(value) for value in data.get("travels", ())),
        **numbers,
    )


def _seen(path: Path) -> tuple[int, str]:
    """Size and digest of a file."""
    return path.stat().st_size, study_file.file_digest(str(path))


def _check_file(path: Path, size: int, digest: str) -> None:
    if not path.is_file():
        raise InputError(f"the checkpoint is incomplete: there is no {path}; {_AGAIN}")
    found = path.stat().st_size
    if found != size:
        raise InputError(f"{path} is damaged: it has {found} bytes, not {size}; {_AGAIN}")
    if _seen(path)[1] != digest:
        raise InputError(f"{path} is damaged: its content has changed; {_AGAIN}")
