"""The tables of a study, read from CSV files."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError, with_key
from contact_locking.expressions import LARGEST, Table
from contact_locking.parallel import on_root
from contact_locking.plain_text import nearest
from contact_locking.study_file.parameters import TableParameters

# A larger file is no table of loads.
_MOST_BYTES, _MOST_ROWS, _LONGEST_LINE = 50_000_000, 1_000_000, 100_000

_SEPARATORS = {";": "semicolons", "\t": "tabs"}


def read_tables(comm: MPI.Intracomm, given: Mapping[str, TableParameters]) -> dict[str, Table]:
    """The tables by name, which rank 0 reads; collective.

    Raises InputError with the key of the table for a file that cannot be used.
    """
    tables = {}
    for name, table in given.items():
        points, values = on_root(comm, partial(_read, name, table))
        tables[name] = Table(name, points, values)
    return tables


def _read(name: str, given: TableParameters) -> tuple[FloatArray, FloatArray]:
    path = Path(given.file)
    key = f"tables.{name}"
    try:
        size = path.stat().st_size
        if size > _MOST_BYTES:
            raise InputError(
                f"{path} has {size / 1e6:.0f} MB; at most {_MOST_BYTES / 1e6:.0f} MB are allowed",
                f"{key}.file",
            )
        # utf-8-sig, because spreadsheets begin a file with a byte order mark.
        with path.open(encoding="utf-8-sig", newline="") as stream:
            return _columns(csv.reader(_lines(stream)), path, given, key)
    except UnicodeDecodeError:
        raise InputError(f"{path} is no text in UTF-8", f"{key}.file") from None
    except csv.Error as error:
        raise InputError(f"{path} is no CSV file: {error}", f"{key}.file") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}", f"{key}.file") from None


def _lines(stream: Iterable[str]) -> Iterator[str]:
    for line in stream:
        if len(line) > _LONGEST_LINE:
            raise csv.Error(f"a line has more than {_LONGEST_LINE} characters")
        yield line


def _columns(
    rows: Iterator[list[str]], path: Path, given: TableParameters, key: str
) -> tuple[FloatArray, FloatArray]:
    header = [column.strip() for column in next(rows, [])]
    places = [
        with_key(f"{key}.{which}", partial(_place, column, header, path))
        for which, column in (("over", given.over), ("column", given.column))
    ]
    found: list[tuple[float, float]] = []
    for number, row in enumerate(rows, 2):
        if not any(cell.strip() for cell in row):
            continue
        if len(found) == _MOST_ROWS:
            raise InputError(f"{path} has more than {_MOST_ROWS} rows", f"{key}.file")
        point, value = (_number(row, place, f"{path}, row {number}", key) for place in places)
        if found and not point > found[-1][0]:
            raise InputError(
                f"{path}, row {number}: {given.over} = {point:g} follows {found[-1][0]:g}; the "
                "arguments must ascend",
                f"{key}.over",
            )
        found.append((point, value))
    if len(found) < 2:
        raise InputError(f"{path} has {len(found)} rows of numbers; 2 are the least", f"{key}.file")
    points, values = np.array(found).T
    return points.copy(), values.copy()


def _place(column: str, header: list[str], path: Path) -> int:
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


def _number(row: list[str], place: int, where: str, key: str) -> float:
    text = row[place].strip() if place < len(row) else ""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST:
        raise InputError(
            f"{where}: {text[:40]!r} is no number of at most {LARGEST:g}", f"{key}.file"
        )
    return value
