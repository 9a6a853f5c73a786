"""Files and folders that appear complete or not at all.

A new file is written into a staging folder on the same disk and renamed when it is complete.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from contact_locking.files.lock import try_lock

_PREFIX = ".partial-contact-locking-"
# The errors of file systems that cannot reserve disk space.
_CANNOT_RESERVE = (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS, errno.ENODEV)


@contextlib.contextmanager
def staging(directory: Path) -> Iterator[Path]:
    """A new folder in ``directory`` for unfinished files, removed after the block.

    A lock tells `remove_abandoned` that the folder is in use.  Raises OSError.
    """
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=directory))
    mark = os.open(folder, os.O_RDONLY)
    try:
        try_lock(mark)
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(mark)


def put_in_place(new: Path, place: Path) -> None:
    """Move a file or folder from a staging folder to ``place``, and replace what is there.

    If ``new`` does not exist, ``place`` is removed.  Raises OSError.
    """
    # os.replace replaces a file in one step, but no folder: an old folder moves to the staging
    # folder.
    if place.is_dir() or not new.exists():
        with contextlib.suppress(FileNotFoundError):
            place.rename(new.with_name(f"old-{new.name}"))
    if new.exists():
        os.replace(new, place)


def write_new(path: Path, content: bytes) -> None:
    """Write a file where there is none.  Raises FileExistsError, and OSError."""
    with path.open("xb") as stream:
        try:
            stream.write(content)
            stream.flush()
        except OSError:
            path.unlink(missing_ok=True)
            raise


def write_text(path: Path, text: str) -> None:
    """Replace a text file in one step.  Raises OSError, and keeps the old file then."""
    with staging(path.parent) as folder:
        new = folder / path.name
        new.write_text(text, encoding="utf-8", newline="")
        os.replace(new, path)


def remove_abandoned(directory: Path) -> None:
    """Remove the staging folders whose process was killed.

    A staging folder in use stays.  All stay if the file system has no locks.
    """
    for path in directory.glob(f"{_PREFIX}*"):
        try:
            mark = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        except OSError:
            continue  # not a staging folder, or removed by another process
        try:
            if try_lock(mark):
                shutil.rmtree(path, ignore_errors=True)
        finally:
            os.close(mark)


def require_room(folder: Path, size: int) -> None:
    """Raise OSError if ``folder`` has no room for a file of ``size`` bytes; leave no trace."""
    allocate = getattr(os, "posix_fallocate", None)
    if allocate is None:
        return
    with tempfile.TemporaryFile(dir=folder) as file:
        try:
            allocate(file.fileno(), 0, size)
        except OSError as error:
            if error.errno not in _CANNOT_RESERVE:
                raise OSError(error.errno, error.strerror, str(folder)) from error
