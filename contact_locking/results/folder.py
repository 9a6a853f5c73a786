"""The folder of a run or a study: the names of its files, and one run at a time in it."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from contact_locking.errors import InputError, explained
from contact_locking.files import atomic
from contact_locking.files.atomic import locked, new_folders

if TYPE_CHECKING:
    from mpi4py import MPI

T = TypeVar("T")

#: The first line of every file with the parameters of a run or of a study.
HEADER = "# All parameters, written by contact_locking\n"
#: The key of the study file with the folder.
KEY = "output.directory"
SUMMARY, PARAMETERS, FIELDS = "summary.json", "parameters.yaml", "fields.bp"
#: The fields for tools that do not read VTX: XDMF, and its data in HDF5.
XDMF, XDMF_DATA = "fields.xdmf", "fields.h5"
#: A row of numbers for each step of a process.
HISTORY = "history.csv"
CONTACT, FACETS = "contact.csv", "contact_facets.csv"
#: The fields at the points of the probes.
PROBES = "probes.csv"
#: The points of a branch of solutions.
BRANCHES = "branches.csv"
#: The picture of a run.
PICTURE = "picture.png"
#: A fit to measured curves: its numbers, and the picture of data and model.
FIT, FIT_PICTURE = "fit.json", "fit.png"
#: The report of a run or a study: its page, which a new run makes out of date, and its charts.
PAGE, CHARTS = "report.html", "report"
#: The folder of the saved state, and the file in it that says of what.
CHECKPOINT, RECORD = "checkpoint", "record.json"
#: All of a run in the order in which they are put in place: a folder with a summary has the others.
FILES_OF_RUN = (
    *(PARAMETERS, CONTACT, FACETS, HISTORY, FIELDS, XDMF_DATA, XDMF, PROBES),
    *(BRANCHES, PICTURE, FIT, FIT_PICTURE, PAGE, CHECKPOINT, SUMMARY),
)
#: More than the bytes of a summary, the parameters and some hundred contact points.
TEXTS_BYTES = 65_536
#: The table of a study, in CSV and in JSON lines.
TABLE_CSV, TABLE_LINES = "table.csv", "table.jsonl"


def folder_of(number: int) -> str:
    """The folder of solution 2, 3, ... below that of the first."""
    return f"equilibrium_{number}"


def not_writable(directory: object) -> str:
    """The message about a folder that results cannot be written to, with a long path shortened."""
    path = str(directory)
    shown = path if len(path) <= 300 else f"{path[:200]}...{path[-80:]}"
    return f"results cannot be written to {shown}"


def require_own(directory: Path, names: Sequence[str] = FILES_OF_RUN) -> None:
    """Raise InputError if results would replace files that no run or study has written; OSError.

    In the folder of an earlier run or study, which its parameters tell, or else its summary,
    results replace all files of their names; elsewhere they replace a saved state only.
    """
    for name, mark in ((PARAMETERS, HEADER), (SUMMARY, '"friction_fixed_point": {')):
        path = directory / name
        if path.is_file() and mark.encode() in path.read_bytes():
            return
    for path in [directory / name for name in names]:
        if os.path.lexists(path) and not (path / RECORD).is_file():
            raise InputError(
                f"{path}: was not written by an earlier run, and would be replaced; move it away, "
                "or write to another folder",
                KEY,
            )


@contextlib.contextmanager
def reserved(directory: str | Path, comm: MPI.Intracomm) -> Iterator[None]:
    """Keep ``directory`` for the results of one run; collective.

    Enter the block before the solve, which may take hours.  The unfinished files of a killed run
    are removed, and a new folder is removed again if no file is written.  Raises the errors of
    `prepare`, and InputError if another run or a study writes to the folder.
    """
    target = Path(directory)
    with contextlib.ExitStack() as stack:

        def attempt() -> None:
            stack.enter_context(new_folders(target))
            stack.enter_context(locked(target, "run"))
            atomic.remove_abandoned(target)
            require_own(target)
            _require_writable(target)

        on_root_of(comm, target, attempt)
        yield


def prepare(directory: str | Path, comm: MPI.Intracomm) -> None:
    """Raise InputError if results cannot be written to ``directory``; leave no trace; collective.

    Raises ContactLockingError if the disk has no room for the text files.
    """
    target = Path(directory)

    def attempt() -> None:
        with new_folders(target):
            require_own(target)
            _require_writable(target)

    on_root_of(comm, target, attempt)


def on_root_of(comm: MPI.Intracomm, directory: Path, work: Callable[[], T]) -> T:
    """`on_root` with an error about the folder in place of an OSError; collective."""
    # Study files are read without MPI.
    from contact_locking.parallel import on_root

    def attempt() -> T:
        with explained_in(directory):
            return work()

    return on_root(comm, attempt)


def explained_in(directory: Path) -> contextlib.AbstractContextManager[None]:
    """Raise an error about the folder of the results in place of an OSError."""
    return explained(not_writable(directory), directory, KEY)


def _require_writable(directory: Path) -> None:
    """Raise OSError if the folder has no room for the text files; leave no trace."""
    with atomic.staging(directory) as folder:
        atomic.require_room(folder, TEXTS_BYTES)
