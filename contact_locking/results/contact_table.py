"""contact.csv and contact_facets.csv: the points and the facets of Gamma_C as text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from contact_locking.arrays import AXES, IntArray
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
    """The points in the text of `points_text`, the file ``name``.

    Raises InputError with the line for a row that is none, and KeyError for a column that is not
    there.
    """
    header, rows = read_own(text, name, _number)
    columns = _columns([axis for axis in AXES if axis in header])
    found = dict(zip(header, np.array(rows).reshape(-1, len(header)).T, strict=True))
    arrays: dict[str, Any] = {
        field: np.column_stack([found[name] for name in names])
        if len(names) > 1
        else found[names[0]]
        for field, names in columns.items()
    }
    whole = {field: arrays[field].astype(np.int64) for field in ("state", "contact")}
    return ContactPoints(**arrays | whole)


def read_facets(text: str, name: str, dim: int) -> IntArray:
    """The facets (m, d) in the text of `facets_text`, as `read_points`; ``dim`` is d."""
    _, rows = read_own(text, name, lambda _, cell: int(cell))
    return np.array(rows, dtype=np.int64).reshape(-1, dim)


def _number(column: str, cell: str) -> float:
    if column == "state":
        return STATE_NAMES.index(cell)
    number = int(cell) if column == "contact" else float(cell)
    if not math.isfinite(number):
        raise ValueError
    return number
