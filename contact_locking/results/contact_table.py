"""contact.csv and contact_facets.csv: the points and the facets of Gamma_C as text."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from contact_locking.arrays import AXES, IntArray
from contact_locking.errors import InputError
from contact_locking.files.csv_file import csv_text
from contact_locking.results.contact_points import STATE_NAMES, ContactPoints

_Row = tuple[int, list[str]]


def _columns(axes: Sequence[str]) -> dict[str, list[str]]:
    """The columns of each field of the contact points, in the order of the file."""

    def vector(name: str) -> list[str]:
        return [f"{name}_{axis}" for axis in axes]

    return {
        "x": [*axes],
        "u_normal": ["u_normal"],
        "u_tangent": vector("u_tangent"),
        "gap": ["gap"],
        "pressure": ["pressure"],
        "traction": vector("traction_tangent"),
        "bound": ["bound"],
        "state": ["state"],
        "normal": vector("normal"),
        "contact": ["contact"],
    }


def points_text(points: ContactPoints) -> str:
    """The header and a row for each point."""
    columns = _columns(AXES[: points.dim])
    cells: list[Any] = []
    for field, names in columns.items():
        values: Any = getattr(points, field).reshape(len(points), len(names)).T
        cells += [[STATE_NAMES[i] for i in values[0]]] if field == "state" else values.tolist()
    return csv_text((name for own in columns.values() for name in own), zip(*cells, strict=True))


def facets_text(facets: IntArray) -> str:
    """The header and a row for each facet (m, d): its corners as point numbers from 0."""
    rows: Any = facets.tolist()
    return csv_text((f"point_{corner}" for corner in range(facets.shape[1])), rows)


def read_points(text: str, name: str) -> ContactPoints:
    """The points in the text of the file ``name``.

    Without a column ``contact`` all points belong to contact 0.  Raises InputError with the line
    for a table that `points_text` has not written.
    """
    header, rows = _table(text, name)
    axes = tuple(axis for axis in AXES if axis in header)
    columns = _columns(axes)
    names = [column for group in columns.values() for column in group]
    places = {column: header.index(column) for column in names if column in header}
    missing = [column for column in names[:-1] if column not in places]
    if missing or not 2 <= len(axes) <= 3:
        raise InputError(f"{name}:1: is damaged: there is no column {', '.join(missing or 'xy')}")
    # The last column is the number of the contact, which is 0 in a file without this column.
    numbers = np.zeros((len(rows), len(names)))
    for index, (line, cells) in enumerate(rows):
        try:
            found = [_number(column, cells[place]) for column, place in places.items()]
        except (ValueError, IndexError, OverflowError):
            raise InputError(f"{name}:{line}: is damaged: no row of {len(header)} values") from None
        numbers[index, : len(found)] = found
    if not np.isfinite(numbers).all():
        line = rows[int(np.argmin(np.isfinite(numbers).all(axis=1)))][0]
        raise InputError(f"{name}:{line}: holds a value that is not finite")
    contact = numbers[:, -1]
    if len(rows) and (contact[0] < 0 or contact[-1] >= len(rows) or (np.diff(contact) < 0).any()):
        raise InputError(f"{name}: is damaged: the points are not sorted by contact")
    ends = np.cumsum([len(group) for group in columns.values()])
    arrays: dict[str, Any] = dict(zip(columns, np.split(numbers, ends[:-1], axis=1), strict=True))
    for field, values in arrays.items():
        whole = field in ("state", "contact")
        values = values.astype(np.int64) if whole else values
        arrays[field] = values if len(columns[field]) > 1 else values[:, 0]
    return ContactPoints(**arrays)


def read_facets(text: str, name: str, points: ContactPoints) -> IntArray:
    """The facets (m, d) in the text of the file ``name``, as numbers of ``points``.

    Raises InputError with the line for a table that `facets_text` has not written for these
    points.
    """
    rows = _table(text, name)[1]
    facets = np.empty((len(rows), points.dim), dtype=np.int64)
    for index, (line, cells) in enumerate(rows):
        try:
            facets[index] = [int(cell) for cell in cells]
        except (ValueError, OverflowError):
            raise InputError(f"{name}:{line}: is damaged: no {points.dim} numbers") from None
    if facets.size and not 0 <= facets.min() <= facets.max() < len(points):
        raise InputError(f"{name}: is damaged: it names points that are not in contact.csv")
    if np.ptp(points.contact[facets], axis=1).any():
        raise InputError(f"{name}: is damaged: a facet joins points of different contacts")
    return facets


def _number(column: str, cell: str) -> float:
    if column == "state":
        return STATE_NAMES.index(cell)
    return int(cell) if column == "contact" else float(cell)


def _table(text: str, name: str) -> tuple[list[str], list[_Row]]:
    """The header, and each row with its line number."""
    reader = csv.reader(io.StringIO(text, newline=""))
    try:
        lines: list[_Row] = [(reader.line_num, cells) for cells in reader]
    except csv.Error as error:
        raise InputError(f"{name}:{reader.line_num}: is damaged: {error}") from None
    if not lines:
        raise InputError(f"{name}: is empty; solve the run again")
    return lines[0][1], lines[1:]
