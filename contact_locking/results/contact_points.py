"""The points of Gamma_C in an order by geometry alone, and the tables of contact.csv."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from contact_locking.arrays import AXES, FloatArray, IntArray
from contact_locking.results.table import Table

OPEN, STICK, SLIP = 0, 1, 2
STATE_NAMES = ("open", "stick", "slip")
# The columns of contact.csv in their order, those of vectors without their axes.
_COLUMNS = {
    **{"x": "", "u_normal": "u_normal", "u_tangent": "u_tangent", "gap": "gap"},
    **{"pressure": "pressure", "traction": "traction_tangent", "bound": "bound"},
    **{"state": "state", "normal": "normal", "contact": "contact"},
}
_STRESSES, _NUMBERS = ("pressure", "traction", "bound"), ("state", "normal", "contact")


@dataclass(frozen=True)
class ContactPoints:
    """The k nodes of Gamma_C, contact after contact; a node of two contacts is a point of both.

    The points of a contact follow the curves of Gamma_C in 2D and are sorted lexicographically in
    3D.  Vectors are (k, d) and scalars are (k,).

    - ``traction``, ``bound``: ``sigma_tau`` on the body, and ``mu |R sigma_nu|``
    - ``state``, ``contact``: OPEN, STICK or SLIP; the number of the contact, ascending from 0
    """

    x: FloatArray
    normal: FloatArray
    u_normal: FloatArray
    u_tangent: FloatArray
    gap: FloatArray
    pressure: FloatArray
    traction: FloatArray
    bound: FloatArray
    state: IntArray
    contact: IntArray

    @classmethod
    def none(cls, dim: int) -> ContactPoints:
        """The points of a body without contact."""
        vector, scalar, number = np.empty((0, dim)), np.empty(0), np.empty(0, dtype=np.int64)
        return cls(vector, vector, scalar, vector, scalar, scalar, vector, scalar, number, number)

    @property
    def dim(self) -> int:
        return int(self.x.shape[1])

    def __len__(self) -> int:
        return len(self.x)

    def __getitem__(self, rows: slice) -> ContactPoints:
        return ContactPoints(*(getattr(self, column.name)[rows] for column in fields(self)))

    def rows(self) -> list[slice]:
        """The rows of each contact."""
        starts = np.unique(self.contact, return_index=True)[1]
        ends = itertools.pairwise([*map(int, starts), len(self)])
        return [slice(start, end) for start, end in ends]

    def parts(self) -> list[ContactPoints]:
        """The points of each contact."""
        return [self[rows] for rows in self.rows()]

    @property
    def table(self) -> Table:
        """The columns of contact.csv, with states as words."""
        columns, units = dict[str, Any](), dict[str, str]()
        for key, name in _COLUMNS.items():
            values, before = getattr(self, key), len(columns)
            if key == "state":
                columns[name] = [STATE_NAMES[state] for state in values]
            elif values.ndim == 1:
                columns[name] = values
            else:
                columns |= zip(_with_axes(name, AXES[: self.dim]), values.T, strict=True)
            if key not in _NUMBERS:
                unit = "stress" if key in _STRESSES else "length"
                units |= dict.fromkeys([*columns][before:], unit)
        return Table(columns, units)

    @classmethod
    def of(cls, table: Table) -> ContactPoints:
        """The points of a :attr:`table`.  Raises KeyError for a column that is not there."""
        axes = [axis for axis in AXES if axis in table.columns]
        columns: dict[str, Any] = {}
        for key, name in _COLUMNS.items():
            if key == "state":
                columns[key] = np.array([STATE_NAMES.index(x) for x in table.columns[name]], int)
            elif name in table.columns:
                columns[key] = table.column(name)
            else:
                columns[key] = np.column_stack([table.column(x) for x in _with_axes(name, axes)])
        return cls(**columns | {"contact": table.whole("contact")})


def _with_axes(name: str, axes: Sequence[str]) -> list[str]:
    return [f"{name}_{axis}" if name else axis for axis in axes]


def joined(
    contacts: Sequence[tuple[ContactPoints, IntArray]], dim: int
) -> tuple[ContactPoints, IntArray]:
    """The points and the facets (m, d) of all contacts, which are numbered by their order.

    The given facets number the points of their contact; the returned facets number all points.
    """
    numbered = [
        replace(points, contact=np.full(len(points), number))
        for number, (points, _) in enumerate(contacts)
    ]
    tables = [ContactPoints.none(dim), *numbered]
    points = ContactPoints(
        *(
            np.concatenate([getattr(table, column.name) for table in tables])
            for column in fields(ContactPoints)
        )
    )
    firsts = itertools.accumulate((len(table) for table, _ in contacts), initial=0)
    facets = [first + numbers for first, (_, numbers) in zip(firsts, contacts, strict=False)]
    return points, np.concatenate([np.empty((0, dim), dtype=np.int64), *facets])


def lexicographic(x: FloatArray) -> IntArray:
    """The order of points (k, d) by x, then y, then z; rounding does not change the order."""
    size = float(np.ptp(x, axis=0).max()) if len(x) else 1.0
    return np.lexsort(np.round(x / (size or 1.0), 9).T[::-1])


def facets_of(x: FloatArray, corners: FloatArray) -> IntArray:
    """Facets (m, d) as numbers of points x (k, d), from the coordinates (m, d, d) of their corners.

    Every facet occurs once, with ascending numbers, and the facets are sorted.
    """
    from scipy.spatial import cKDTree

    numbers = cKDTree(x).query(corners)[1]
    return np.unique(np.sort(numbers, axis=1), axis=0).astype(np.int64)


def curves(segments: IntArray) -> list[IntArray]:
    """The curves that consist of segments (m, 2) of numbered points, as numbers of their points.

    An open curve begins at the end with the lower number.  A closed curve begins at its lowest
    number, goes to the lower neighbour, and repeats its first point at the end.  The curves are
    sorted by their first points.
    """
    neighbours: dict[int, list[int]] = {}
    for a, b in np.unique(np.sort(segments, axis=1), axis=0):
        neighbours.setdefault(int(a), []).append(int(b))
        neighbours.setdefault(int(b), []).append(int(a))
    for joined in neighbours.values():
        joined.sort()
    ends = [point for point, joined in neighbours.items() if len(joined) == 1]
    lines = []
    for start in [*sorted(ends), *sorted(neighbours)]:
        curve = [start]
        while neighbours[curve[-1]]:
            following = neighbours[curve[-1]].pop(0)
            neighbours[following].remove(curve[-1])
            curve.append(following)
        if len(curve) > 1:
            lines.append(np.array(curve, dtype=np.int64))
    return sorted(lines, key=lambda curve: int(curve[0]))


def along_curves(x: FloatArray, segments: FloatArray) -> IntArray:
    """The order of points (k, 2) along the curves made of ``segments`` (s, 2, 2).

    The points are numbered lexicographically; for the start of each curve see `curves`.
    """
    from scipy.spatial import cKDTree

    order = lexicographic(x)
    walked = curves(cKDTree(x[order]).query(segments)[1])
    # A point where curves meet is on several curves and must occur once.
    return order[list(dict.fromkeys(int(point) for curve in walked for point in curve))]
