"""Whether there is a file to read, its digest, and the name that a user may have meant."""

from __future__ import annotations

import contextlib
import csv
import hashlib
import itertools
import math
import os
import stat
from collections.abc import Iterable, Iterator
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


def number_at(place: int, row: list[str]) -> tuple[float, str]:
    """The number in a row, NaN if there is none, and the text that stands there."""
    text = row[place].strip() if place < len(row) else ""
    try:
        return float(text), text[:40]
    except ValueError:
        return math.nan, text[:40]
