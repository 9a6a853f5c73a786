"""A height map from a CSV or NumPy file, as triangles: a measured surface as a foundation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import InputError

ENDINGS = (".csv", ".npy")
# As many heights are two million triangles.
_MOST = 1_000_000
# Coordinates of one line of the grid may differ by this share of the length of the grid.
_SAME = 1e-6


def read_heights(path: Path, spacing: Sequence[float] | None) -> tuple[FloatArray, IntArray]:
    """The corners (m, 3), and the triangles (n, 3) that run counterclockwise seen from above.

    With ``spacing`` (2,) the file holds heights: row j and column i are at (i dx, j dy).  Without,
    its rows are x, y, z at all places of a rectangular grid.  Each rectangle of the
    grid is two triangles.  Raises InputError for a file that holds no such numbers.
    """
    numbers = _numbers(path)
    if numbers.size > _MOST * (1 if spacing else 3):
        raise InputError(f"{path} has more than {_MOST} heights; take a coarser grid")
    if not np.isfinite(numbers).all():
        row = int(np.argmax(~np.isfinite(numbers).all(axis=1))) + 1
        count = np.count_nonzero(~np.isfinite(numbers))
        raise InputError(f"{path}: {count} of its numbers are not finite, the first in row {row}")
    x, y, heights = _at_spacing(numbers, spacing) if spacing else _of_rows(numbers, path)
    if min(heights.shape) < 2:
        shape = " by ".join(map(str, heights.shape))
        raise InputError(f"{path} is no surface: its grid has {shape} heights")
    along, across = np.meshgrid(x, y)
    corners = np.column_stack([along.ravel(), across.ravel(), heights.ravel()])
    number = np.arange(heights.size).reshape(heights.shape)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    triangles = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return corners, triangles


def _numbers(path: Path) -> FloatArray:
    """The rows of a file, (rows, columns)."""
    try:
        if path.suffix.lower() == ".npy":
            found = np.load(path, allow_pickle=False)
        else:
            with path.open(encoding="utf-8-sig") as stream:
                found = np.loadtxt(stream, delimiter=",", skiprows=_heading(path), ndmin=2)
        found = np.asarray(found, dtype=float)
    except (ValueError, TypeError, EOFError, OSError) as error:
        raise InputError(f"{path} cannot be read as rows of numbers: {error}") from None
    if found.ndim != 2:
        raise InputError(f"{path} has {found.ndim} axes; a height map has 2")
    return found


def _heading(path: Path) -> int:
    """1 if the first line of a CSV file is no line of numbers, else 0."""
    with path.open(encoding="utf-8-sig") as stream:
        first = stream.readline(100_000).split(",")[0].strip()
    try:
        float(first)
    except ValueError:
        return 0 if first.startswith("#") else 1
    return 0


def _at_spacing(
    heights: FloatArray, spacing: Sequence[float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    x, y = (
        np.asarray(step * np.arange(count), dtype=float)
        for step, count in zip(spacing, heights.T.shape, strict=True)
    )
    return x, y, heights


def _of_rows(rows: FloatArray, path: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coordinates (columns,), (rows,) and heights (rows, columns) from rows x, y, z."""
    if rows.shape[1] != 3:
        raise InputError(
            f"{path} has {rows.shape[1]} columns, not x, y, z; for a grid of heights give "
            "spacing: [dx, dy]"
        )
    (x, i), (y, j) = (_lines(rows[:, axis]) for axis in range(2))
    heights = np.full((len(y), len(x)), np.nan)
    heights[j, i] = rows[:, 2]
    if len(rows) != heights.size or np.isnan(heights).any():
        raise InputError(
            f"{path} has {len(rows)} rows, and {len(x)} different x times {len(y)} different y are "
            f"{heights.size}: the places do not fill a rectangular grid"
        )
    return x, y, heights


def _lines(values: FloatArray) -> tuple[FloatArray, IntArray]:
    """The different values, ascending, and for each value the number of its own."""
    order = np.argsort(values)
    ascending = values[order]
    steps = np.diff(ascending) > _SAME * (ascending[-1] - ascending[0])
    starts = np.append(0, np.flatnonzero(steps) + 1)
    number = np.empty(len(values), dtype=np.int64)
    number[order] = np.append(0, np.cumsum(steps))
    return ascending[starts], number
