"""Tables of numbers in CSV files, which expressions use by name."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from contact_locking.arrays import LARGEST, FloatArray
from contact_locking.errors import InputError, with_key
from contact_locking.expressions import Table
from contact_locking.files.readable import number_at, place_of, rows_of

from .concept import Concept, Fault, entry
from .kinds import File, Text

# A longer file is no table of loads.
_MOST_ROWS = 1_000_000


class TableFile(Concept):
    """Two columns of a CSV file, interpolated linearly between the rows."""

    file: File = entry(..., "a CSV file with a row of column names, relative to the study file")
    over: Text = entry(..., "the name of the column with the ascending arguments")
    column: Text = entry(..., "the name of the column with the values")

    def table(self, name: str) -> Table:
        """The table with its name.  Raises InputError for a file that cannot be used."""
        stat = with_key("file", lambda: Path(self.file).stat())
        return Table(name, *_read(self.file, self.over, self.column, stat.st_mtime_ns))

    def _faults(self) -> Iterator[Fault]:
        try:
            self.table("")
        except InputError as error:
            yield Fault((error.key or "file",), str(error))


# Every case of a study reads the same file.
@lru_cache(maxsize=100)
def _read(file: str, over: str, column: str, changed: int) -> tuple[FloatArray, FloatArray]:
    path = Path(file)
    with rows_of(path, "file") as rows:
        return _columns(rows, path, over, column)


def _columns(
    rows: Iterator[list[str]], path: Path, over: str, column: str
) -> tuple[FloatArray, FloatArray]:
    header = [name.strip() for name in next(rows, [])]
    places = [
        with_key(key, partial(place_of, name, header, path))
        for key, name in (("over", over), ("column", column))
    ]
    pairs: list[tuple[float, float]] = []
    for number, row in enumerate(rows, 2):
        if not any(cell.strip() for cell in row):
            continue
        if len(pairs) == _MOST_ROWS:
            raise InputError(f"{path} has more than {_MOST_ROWS} rows", "file")
        point, value = (_number(row, place, f"{path}, row {number}") for place in places)
        if pairs and not point > pairs[-1][0]:
            raise InputError(
                f"{path}, row {number}: {over} = {point:g} follows {pairs[-1][0]:g}; the "
                "arguments must ascend",
                "over",
            )
        pairs.append((point, value))
    if len(pairs) < 2:
        raise InputError(f"{path} has {len(pairs)} rows of numbers; 2 are the least", "file")
    points, values = np.array(pairs).T
    return points.copy(), values.copy()


def _number(row: list[str], place: int, where: str) -> float:
    value, text = number_at(place, row)
    if not abs(value) <= LARGEST:
        raise InputError(f"{where}: {text!r} is no number of at most {LARGEST:g}", "file")
    return value
