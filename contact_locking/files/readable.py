"""Whether there is a file to read, its digest, and the name that a user may have meant."""

from __future__ import annotations

import hashlib
import itertools
import os
import stat
from pathlib import Path

from contact_locking.errors import InputError
from contact_locking.plain_text import nearest, printable

#: Larger files are not read: 250 MB hold 5 million triangles in binary form.
LARGEST_FILE = 250_000_000
# To compare more names takes longer than a message should.
_MOST_NAMES = 1000


def require_file(path: Path, kind: str = "mesh file") -> None:
    """Raise InputError unless the path is a regular file.

    This comes before a file is opened: to open a pipe would wait for a writer.
    """
    if not path.exists():
        raise InputError(f"there is no {kind} {path}")
    if not stat.S_ISREG(path.stat().st_mode):
        raise InputError(f"{path} is no file")


def require_size(path: Path) -> None:
    """Raise InputError unless the path is a file of at least 1 and at most `LARGEST_FILE` bytes."""
    require_file(path, "file")
    size = path.stat().st_size
    if size > LARGEST_FILE:
        raise InputError(
            f"{path} has {size / 1e6:.0f} MB, and at most {LARGEST_FILE / 1e6:.0f} MB are "
            "read; make the tool coarser, which need not be finer than the mesh of the body"
        )
    if size == 0:
        raise InputError(f"{path} is empty")


def file_digest(path: str) -> str:
    """The SHA-256 of a file's content. Raises OSError."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def similar(path: Path) -> str:
    """The hint at the file in the same folder whose name is most like that of ``path``."""
    try:
        with os.scandir(path.parent) as entries:
            names = [entry.name for entry in itertools.islice(entries, _MOST_NAMES)]
    except (OSError, ValueError):  # no folder, or a name that no folder can have
        return ""
    return printable(nearest(path.name, sorted(names)))
