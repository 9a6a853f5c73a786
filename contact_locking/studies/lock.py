"""One study at a time in a folder."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import socket
from collections.abc import Iterator
from pathlib import Path

from contact_locking.errors import InputError

_NAME = ".lock"


@contextlib.contextmanager
def locked(directory: Path) -> Iterator[bool]:
    """Hold the lock of a study's folder; False where the file system has no locks.

    The operating system takes the lock from a process that ends, in whatever way: the file that
    stays behind locks nothing.  Raises InputError if another study holds it, OSError if the
    folder cannot be written to.
    """
    with (directory / _NAME).open("a+", encoding="utf-8") as file:
        held = _take(file.fileno())
        if held is None:
            file.seek(0)
            holder = file.read(200).strip() or "another process"
            raise InputError(
                f"another study is running in {directory} ({holder}); wait until it has ended, "
                "stop it, or give this one another folder with --output"
            )
        file.truncate(0)
        file.write(f"process {os.getpid()} on {socket.gethostname()}\n")
        file.flush()
        yield held


def _take(descriptor: int) -> bool | None:
    """Whether the lock was taken; None if it is held by another, False if there are none."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return None
    except OSError as error:
        if error.errno in (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP):
            return False
        raise
    return True
