"""Files and folders that appear complete or not at all.

They are written into a staging folder beside their place and moved there when they are complete.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from contact_locking.files.lock import try_lock

_PREFIX = ".partial-"
# tempfile.mkdtemp ends its names with eight of these characters.
_NAME = re.compile(re.escape(_PREFIX) + r"[a-z0-9_]{8}")
# Errors of file systems that cannot reserve room.
_CANNOT_RESERVE = (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS, errno.ENODEV)


@contextlib.contextmanager
def staging(directory: Path) -> Iterator[Path]:
    """Give a new folder in ``directory`` for files that are not complete, and remove it at the end.

    A lock marks the folder as used, for `remove_abandoned`.  Raises OSError.
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
    """Move a file or folder from a staging folder to ``place``; if there is none, remove ``place``.

    Raises OSError.
    """
    # One step replaces a file.  An old folder moves into the staging folder, which goes later.
    if place.is_dir() or not new.exists():
        with contextlib.suppress(FileNotFoundError):
            place.rename(new.with_name(f"old-{new.name}"))
    if new.exists():
        os.replace(new, place)


def write_text(path: Path, text: str) -> None:
    """Replace a text file in one step.  Raises OSError; the old file is still there then."""
    with staging(path.parent) as folder:
        new = folder / path.name
        new.write_text(text, encoding="utf-8", newline="")
        os.replace(new, path)


def remove_abandoned(directory: Path) -> None:
    """Remove the staging folders whose process was killed.

    Folders in use stay, and so do all of them where the file system has no locks to tell.
    """
    for path in directory.glob(f"{_PREFIX}*"):
        if not _NAME.fullmatch(path.name):
            continue
        try:
            mark = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        except OSError:
            continue  # no folder of this program, or removed meanwhile
        try:
            if try_lock(mark):
                shutil.rmtree(path, ignore_errors=True)
        finally:
            os.close(mark)


def require_room(folder: Path, size: int) -> None:
    """Raise OSError if a file of ``size`` bytes has no room in ``folder``; leave no trace."""
    allocate = getattr(os, "posix_fallocate", None)
    if allocate is None:
        return
    with tempfile.TemporaryFile(dir=folder) as file:
        try:
            allocate(file.fileno(), 0, size)
        except OSError as error:
            if error.errno not in _CANNOT_RESERVE:
                raise OSError(error.errno, error.strerror, str(folder)) from error
