"""One run or study at a time in a folder, and what they make there before all of it is complete."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import shutil
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path

from contact_locking.errors import InputError

_NAME = ".lock"
_PARTIAL = ".partial-"
# As tempfile.mkdtemp ends its names.
_PARTIAL_NAME = re.compile(re.escape(_PARTIAL) + r"[a-z0-9_]{8}")
# Linux's PATH_MAX, less what the names of results in a folder take.
_LONGEST_PATH = 4096 - 160
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EBADF, errno.EINVAL)


@contextlib.contextmanager
def locked(directory: Path, what: str) -> Iterator[bool]:
    """Hold the lock of a folder for ``what``; False where the file system has no locks.

    The operating system takes the lock from a process that ends, in whatever way: the file that a
    killed process leaves locks nothing.  Raises InputError if another process holds the lock,
    OSError if the folder cannot be written to.
    """
    path = directory / _NAME
    with contextlib.ExitStack() as stack:
        while True:
            file = stack.enter_context(path.open("a+", encoding="utf-8"))
            held = _take(file.fileno())
            # The process that had the lock may have removed the file since it was opened.
            if held is not True or _is_at(file.fileno(), path):
                break
        if held is None:
            file.seek(0)
            holder = file.read(200).strip() or "another process"
            raise InputError(
                f"results are being written to {directory} already, by {holder}; wait until that "
                "has ended, stop it, or give another folder with --output"
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
    """Make a folder and those above; those that were not there go again if they stay empty.

    Raises OSError.
    """
    made: list[Path] = []
    try:
        made += make_folders(directory)
        yield
    finally:
        for path in reversed(made):
            with contextlib.suppress(OSError):
                path.rmdir()


def make_folders(directory: Path) -> list[Path]:
    """Make a folder and those above, and return those that were not there.  Raises OSError."""
    # One after the other: Path.mkdir calls itself for the folder above, too often for some paths.
    if len(os.fsencode(directory.absolute())) > _LONGEST_PATH:
        raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))
    missing = [path for path in (directory, *directory.parents) if not path.exists()]
    made = []
    try:
        for path in reversed(missing):
            path.mkdir(exist_ok=True)
            made.append(path)
    except OSError:
        for path in reversed(made):
            path.rmdir()
        raise
    if not directory.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(directory))
    return made


def make_partial(directory: Path) -> tuple[Path, int]:
    """A new folder in ``directory`` for files that are not complete yet, and what marks it as used.

    The second is for `release`.  Raises OSError.
    """
    folder = Path(tempfile.mkdtemp(prefix=_PARTIAL, dir=directory))
    mark = os.open(folder, os.O_RDONLY)
    _take(mark)
    return folder, mark


def release(folder: Path, mark: int) -> None:
    """Remove a folder of `make_partial` with what is in it."""
    shutil.rmtree(folder, ignore_errors=True)
    os.close(mark)


def remove_abandoned(directory: Path) -> None:
    """Remove the folders of `make_partial` whose process was killed.

    Those in use stay, all of them where the file system cannot tell, and what cannot be removed.
    """
    for path in directory.glob(f"{_PARTIAL}*"):
        if not _PARTIAL_NAME.fullmatch(path.name):
            continue
        try:
            mark = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        except OSError:
            continue  # It is no folder of this program, or has gone.
        try:
            if _take(mark):
                shutil.rmtree(path, ignore_errors=True)
        finally:
            os.close(mark)


def _take(descriptor: int) -> bool | None:
    """Whether the lock was taken; None if it is held by another, False if there are none."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return None
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return False
        raise
    return True


def _is_at(descriptor: int, path: Path) -> bool:
    """Whether an open file is the one at ``path``."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False
