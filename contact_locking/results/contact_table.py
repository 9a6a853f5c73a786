"""contact.csv and contact_facets.csv: the points and the facets of Gamma_C as text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from contact_locking.arrays import AXES, IntArray
from contact_locking.errors import InputError
from contact_locking.files.csv_file import csv_text, read_own
from contact_locking.results.contact_points import STATE_NAMES, ContactPoints


def _columns(axes: Sequence[str]) -> dict[str, list[str]]:

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
    header, rows = read_own(text, name, _number)
    axes = tuple(axis for axis in AXES if axis in header)
    columns = _columns(axes)
    missing = [
        column
        for group in columns.values()
        for column in group
        if column not in (*header, "contact")
    ]
    if missing or not 2 <= len(axes) <= 3:
        raise InputError(f"{name}:1: is damaged: there is no column {', '.join(missing or 'xy')}")
    found = dict(zip(header, np.array(rows).reshape(-1, len(header)).T, strict=True))
    contact = found.setdefault("contact", np.zeros(len(rows)))
    if len(rows) and (contact[0] < 0 or contact[-1] >= len(rows) or (np.diff(contact) < 0).any()):
        raise InputError(f"{name}: is damaged: the points are not sorted by contact")
    arrays: dict[str, Any] = {
        field: np.column_stack([found[name] for name in names])
        if len(names) > 1
        else found[names[0]]
        for field, names in columns.items()
    }
    whole = {field: arrays[field].astype(np.int64) for field in ("state", "contact")}
    return ContactPoints(**arrays | whole)


def read_facets(text: str, name: str, points: ContactPoints) -> IntArray:
    """The facets (m, d) in the text of the file ``name``, as numbers of ``points``.

    Raises InputError with the line for a table that `facets_text` has not written for these
    points.
    """
    columns, rows = read_own(text, name, lambda _, cell: int(cell))
    facets = np.array(rows, dtype=float).reshape(-1, len(columns))
    if facets.size and not 0 <= facets.min() <= facets.max() < len(points):
        raise InputError(f"{name}: is damaged: it names points that are not in contact.csv")
    if len(columns) != points.dim:
        raise InputError(f"{name}:1: is damaged: it has not {points.dim} columns")
    found: IntArray = facets.astype(np.int64)
    if np.ptp(points.contact[found], axis=1).any():
        raise InputError(f"{name}: is damaged: a facet joins points of different contacts")
    return found


def _number(column: str, cell: str) -> float:
    if column == "state":
        return STATE_NAMES.index(cell)
    number = int(cell) if column == "contact" else float(cell)
    if not math.isfinite(number):
        raise ValueError
    return number
