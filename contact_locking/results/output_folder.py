"""Reserves the folder of a run for one run at a time, and checks it before a solve of hours."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from mpi4py import MPI

from contact_locking.errors import explained
from contact_locking.files import atomic
from contact_locking.files.lock import locked, new_folders
from contact_locking.parallel import on_root
from contact_locking.results.names import KEY, TEXTS_BYTES, not_writable, require_own

T = TypeVar("T")


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
