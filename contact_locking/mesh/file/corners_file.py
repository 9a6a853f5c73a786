"""The corners of a polyline from a CSV file."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError
from contact_locking.mesh.file.tool_surface import check_size

#: A longer file is not read.
LARGEST_CSV = 10_000_000


def read_corners(path: Path, most: int) -> FloatArray:
    """The corners (m, 2), at most ``most``, in the first two columns; a heading is left out.

    Raises InputError for a line without two finite numbers.
    """
    check_size(path, LARGEST_CSV)
    found: list[tuple[float, float]] = []
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            for number, row in enumerate(csv.reader(stream), start=1):
                if not row or row[0].lstrip().startswith("#"):
                    continue
                if (corner := _corner(row)) is not None:
                    found.append(corner)
                elif number > 1:
                    raise InputError(f"{path}, line {number}: expected two numbers x, y")
                if len(found) > most:
                    raise InputError(f"{path} has more than {most} corners")
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path} cannot be read as CSV: {error}") from None
    return np.array(found, dtype=float).reshape(-1, 2)


def _corner(row: list[str]) -> tuple[float, float] | None:
    try:
        x, y = float(row[0]), float(row[1])
    except (ValueError, IndexError):
        return None
    return (x, y) if math.isfinite(x) and math.isfinite(y) else None
