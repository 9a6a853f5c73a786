"""The lock that allows one run or study at a time in a folder, and new folders."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import socket
from collections.abc import Iterator
from pathlib import Path

from contact_locking.errors import InputError

_NAME = ".lock"
# The text that a run or study writes into the file, or a killed one has left there.
_CONTENT = re.compile(r"(a \w+, process \d+ on .*\n?)?")
# PATH_MAX of Linux minus the longest path of a result in a folder.
_LONGEST_PATH = 4096 - 160
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EBADF, errno.EINVAL)


@contextlib.contextmanager
def locked(directory: Path, what: str) -> Iterator[bool]:
    """Hold the lock of a folder for ``what``; yields False if the file system has no locks.

    The operating system releases the lock when the process ends, so that the lock file of a killed
    process locks nothing.  Raises InputError if another process holds the lock or if the
    file is of another program, and OSError if the folder cannot be written to.
    """
    path = directory / _NAME
    with contextlib.ExitStack() as stack:
        while True:
            file = stack.enter_context(path.open("a+", encoding="utf-8"))
            held = try_lock(file.fileno())
            # The last holder of the lock may have removed the file between open and lock.
            if held is not True or _is_at(file.fileno(), path):
                break
        if held is None:
            file.seek(0)
            holder = file.read(200).strip() or "another process"
            raise InputError(
                f"results are being written to {directory} already, by {holder}; wait until that "
                "has ended, stop it, or give another folder with --output"
            )
        file.seek(0)
        if not _CONTENT.fullmatch(file.read(1000)):
            raise InputError(
                f"{path}: is not the lock of a run, and would be replaced; move it away, or give "
                "another folder with --output"
            )
        try:
            file.truncate(0)
            file.write(f"a {what}, process {os.getpid()} on {socket.gethostname()}\n")
            file.flush()
            yield held
        finally:
            with contextlib.suppress(OSError):
                path.unlink()


@contextlib.contextmanager
def new_folders(directory: Path) -> Iterator[None]:
    """Make a folder and its parents, and after the block remove the new folders that are empty.

    Raises OSError.
    """
    made = make_folders(directory)
    try:
        yield
    finally:
        _remove_empty(made)


def make_folders(directory: Path) -> list[Path]:
    """Make a folder and its parents, and return the new folders.  Raises OSError."""
    # Path.mkdir(parents=True) is recursive, too deep for very long paths.
    if len(os.fsencode(directory.absolute())) > _LONGEST_PATH:
        raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))
    missing = [path for path in (directory, *directory.parents) if not path.exists()]
    made: list[Path] = []
    try:
        for path in reversed(missing):
            path.mkdir(exist_ok=True)
            made.append(path)
    except OSError:
        _remove_empty(made)
        raise
    if not directory.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(directory))
    return made


def _remove_empty(folders: list[Path]) -> None:
    for path in reversed(folders):
        with contextlib.suppress(OSError):
            path.rmdir()


def try_lock(descriptor: int, waits: bool = False) -> bool | None:
    """Lock an open file or folder, and return True.

    Returns None if another process holds the lock, unless this one ``waits`` for it, and False if
    the file system has no locks.  Raises OSError.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if waits else fcntl.LOCK_NB))
    except BlockingIOError:
        return None
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return False
        raise
    return True


def _is_at(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False
