"""Files: written whole or not at all, locked, and read after a look at what they are.

A new file or folder is written into a staging folder on the same disk and renamed when it is
complete.
"""

from __future__ import annotations

import contextlib
import csv
import errno
import fcntl
import hashlib
import itertools
import math
import os
import re
import shutil
import socket
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from contact_locking.errors import InputError
from contact_locking.plain_text import nearest, printable

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


def replace_file(new: Path, place: Path) -> None:
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


#: Larger files are not read: 250 MB hold 5 million triangles in binary form.
LARGEST_FILE = 250_000_000
# To compare more names takes longer than a message should.
_MOST_NAMES = 1000


def require_file(path: Path, kind: str = "mesh file") -> None:
    """Raise InputError unless the path is a regular file.

    This comes before a file is opened: to open a pipe would wait for a writer.
    """
    if not path.exists():
        raise InputError(f"there is no {kind}: {path}")
    if not stat.S_ISREG(path.stat().st_mode):
        raise InputError(f"{path} is no file")


def require_size(path: Path) -> None:
    """Raise InputError unless the path is a file of at least 1 and at most `LARGEST_FILE` bytes."""
    require_file(path, "file")
    size = path.stat().st_size
    if size > LARGEST_FILE:
        raise InputError(
            f"{path} has {size / 1e6:.0f} MB, and at most {LARGEST_FILE / 1e6:.0f} MB are "
            "read; use a coarser tool: it need not be finer than the mesh of the body"
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


# A larger file is no table.
_MOST_BYTES, _LONGEST_LINE = 50_000_000, 100_000

_SEPARATORS = {";": "semicolons", "\t": "tabs"}


@contextlib.contextmanager
def rows_of(path: Path, key: str) -> Iterator[Iterator[list[str]]]:
    """The rows of a CSV file.  Raises InputError with the key for a file that cannot be read."""
    try:
        size = path.stat().st_size
        if size > _MOST_BYTES:
            raise InputError(
                f"{path} has {size / 1e6:.0f} MB; at most {_MOST_BYTES / 1e6:.0f} MB are allowed",
                key,
            )
        # utf-8-sig, because spreadsheets begin a file with a byte order mark.
        with path.open(encoding="utf-8-sig", newline="") as stream:
            yield csv.reader(_lines(stream))
    except UnicodeDecodeError:
        raise InputError(f"{path} is no text in UTF-8", key) from None
    except csv.Error as error:
        raise InputError(f"{path} is no CSV file: {error}", key) from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}", key) from None


def _lines(stream: Iterable[str]) -> Iterator[str]:
    for line in stream:
        if len(line) > _LONGEST_LINE:
            raise csv.Error(f"a line has more than {_LONGEST_LINE} characters")
        yield line


def place_of(column: str, header: list[str], path: Path) -> int:
    """The place of a column in the first row.  Raises InputError for one that is not there once."""
    if column not in header and len(header) == 1:
        for separator, name in _SEPARATORS.items():
            if separator in header[0]:
                raise InputError(
                    f"{path} has {name} between its columns, as Excel writes them in some "
                    "languages; save it with commas, and with points in the numbers"
                )
    if header.count(column) != 1:
        count = "no column" if column not in header else "several columns"
        guess = nearest(column, header) if column not in header else ""
        raise InputError(
            f"{path} has {count} '{column[:60]}'{guess}; its first row is "
            f"{', '.join(header)[:200]!r}"
        )
    return header.index(column)


def numbers_in(
    rows: Iterable[list[str]], columns: Mapping[str, int], path: Path
) -> list[list[float]]:
    """The numbers of columns, names with their places, in the rows that are not empty.

    Raises InputError with the row and the column of text that is no finite number.
    """
    numbers: list[list[float]] = []
    for line, row in enumerate(rows, 2):
        if any(cell.strip() for cell in row):
            numbers.append([])
            for name, place in columns.items():
                text, value = row[place].strip() if place < len(row) else "", math.nan
                with contextlib.suppress(ValueError):
                    value = float(text)
                if not math.isfinite(value):
                    message = f"{name}: {text[:40]!r} is no finite number"
                    raise InputError(f"{path}, row {line}, {message}")
                numbers[-1].append(value)
    return numbers
