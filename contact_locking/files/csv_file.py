"""CSV files of users, with what is wrong in words."""

from __future__ import annotations

import contextlib
import csv
import math
from collections.abc import Iterable, Iterator
from pathlib import Path

from contact_locking.errors import InputError
from contact_locking.plain_text import nearest

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
