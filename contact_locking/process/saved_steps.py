"""The folder of the steps that a run has solved so far; a killed run continues from it."""

from __future__ import annotations

import contextlib
import json
import shutil
from pathlib import Path

from contact_locking._version import __version__
from contact_locking.files import atomic
from contact_locking.results.folder import RECORD

#: The folder of the saved steps in the folder of a run; it is removed when the run has ended.
FOLDER = "steps"
_RUN = "run.json"


def name_of(number: int) -> str:
    """The name of the folder of the step with this number, counted from 1."""
    return f"{number:06d}"


def saved_steps(directory: Path) -> list[Path]:
    """The saved steps of a run in the order of their times; the saved state if there are none."""
    folder = directory / FOLDER
    found = [path.parent for path in _records(folder)]
    return found or [directory]


def last_number(directory: Path, fingerprint: str) -> int:
    """The number of the last step that a run with these parameters has saved; 0 without one."""
    folder = directory / FOLDER
    with contextlib.suppress(OSError):
        if _is_of(folder, fingerprint) and (records := _records(folder)):
            return int(records[-1].parent.name)
    return 0


def _is_of(folder: Path, fingerprint: str) -> bool:
    mark = folder / _RUN
    return mark.is_file() and mark.read_text(encoding="utf-8") == _mark(fingerprint)


def _mark(fingerprint: str) -> str:
    return json.dumps({"version": __version__, "fingerprint": fingerprint}) + "\n"


def _records(folder: Path) -> list[Path]:
    return sorted(folder.glob(f"[0-9]*/{RECORD}"))


def unfinished(directory: Path, fingerprint: str) -> list[Path]:
    """The saved steps of a killed run with the same parameters; empty if there is none.

    For rank 0.  The saved steps of other parameters are removed, and the folder is prepared for the
    steps of these.  Raises OSError.
    """
    folder = directory / FOLDER
    if _is_of(folder, fingerprint):
        return [path.parent for path in _records(folder)]
    remove(directory)
    folder.mkdir(parents=True, exist_ok=True)
    atomic.write_text(folder / _RUN, _mark(fingerprint))
    return []


def keep(directory: Path, first: int, last: int) -> None:
    """Remove all saved steps but these; for rank 0."""
    for record in _records(directory / FOLDER):
        if not name_of(first) <= record.parent.name <= name_of(last):
            shutil.rmtree(record.parent, ignore_errors=True)


def remove(directory: Path) -> None:
    """Remove all saved steps, and their folder unless it holds other files; for rank 0."""
    folder = directory / FOLDER
    for record in _records(folder):
        shutil.rmtree(record.parent, ignore_errors=True)
    (folder / _RUN).unlink(missing_ok=True)
    atomic.remove_abandoned(folder)
    with contextlib.suppress(OSError):
        folder.rmdir()
