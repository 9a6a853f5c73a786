"""The tables of a study, read from CSV files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import LARGEST, FloatArray
from contact_locking.errors import InputError, with_key
from contact_locking.expressions import Table
from contact_locking.files.csv_file import number_at, place_of, rows_of
from contact_locking.parallel import on_root
from contact_locking.study_file.parameters.boundary import TableParameters

# A longer file is no table of loads.
_MOST_ROWS = 1_000_000


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
    path, key = Path(given.file), f"tables.{name}"
    with rows_of(path, f"{key}.file") as rows:
        return _columns(rows, path, given, key)


def _columns(
    rows: Iterator[list[str]], path: Path, given: TableParameters, key: str
) -> tuple[FloatArray, FloatArray]:
    header = [column.strip() for column in next(rows, [])]
    places = [
        with_key(f"{key}.{which}", partial(place_of, column, header, path))
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


def _number(row: list[str], place: int, where: str, key: str) -> float:
    value, text = number_at(place, row)
    if not abs(value) <= LARGEST:
        raise InputError(f"{where}: {text!r} is no number of at most {LARGEST:g}", f"{key}.file")
    return value
