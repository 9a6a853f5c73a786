"""The result of a solve: the displacement, the fields derived from it, and the summary."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from contact_locking.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from dolfinx import fem

    from contact_locking.domain import Domain
    from contact_locking.parameters import Parameters
    from contact_locking.results.derived import ContactFields

OPEN, STICK, SLIP = 0, 1, 2
STATE_NAMES = ("open", "stick", "slip")


@dataclass(frozen=True)
class ContactPoints:
    """The k nodes of Gamma_C, contact after contact; a node of two contacts is a point of both.

    The points of a contact follow its curves in 2D and are sorted lexicographically in 3D.
    Vectors are (k, d), scalars (k,); ``state`` holds OPEN, STICK or SLIP.  ``traction`` is
    ``sigma_tau``, the friction traction on the body, ``bound`` is ``mu |R sigma_nu|``, and
    ``contact`` is the number of the contact, which ascends from 0.
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
        return cls(
            x=vector,
            normal=vector,
            u_normal=scalar,
            u_tangent=vector,
            gap=scalar,
            pressure=scalar,
            traction=vector,
            bound=scalar,
            state=number,
            contact=number,
        )

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


def joined(
    contacts: Sequence[tuple[ContactPoints, IntArray]], dim: int
) -> tuple[ContactPoints, IntArray]:
    """The points and the facets (m, d) of all contacts, which are numbered by their order.

    Given facets are numbers of the contact's own points, those returned of all points.
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
    facets = [first + own for first, (_, own) in zip(firsts, contacts, strict=False)]
    return points, np.concatenate([np.empty((0, dim), dtype=np.int64), *facets])


def facets_within(facets: IntArray, rows: slice) -> IntArray:
    """The facets (m, d) of one contact as numbers of its own points, which are these rows."""
    own = (facets[:, 0] >= rows.start) & (facets[:, 0] < rows.stop)
    return facets[own] - rows.start


def contact_name(summary: Mapping[str, Any], number: int) -> str:
    """The boundary parts of a contact as the summary names them, otherwise "contact 1", ..."""
    listed = summary.get("contacts")
    entry = listed[number] if isinstance(listed, list) and number < len(listed) else None
    on = entry.get("on") if isinstance(entry, Mapping) else None
    names = [on] if isinstance(on, str) else on
    if isinstance(names, list | tuple) and names:
        return ", ".join(str(name) for name in names)
    return f"contact {number + 1}"


@dataclass
class Solution:
    """A solved state.  Every rank has its share of the fields; rank 0 has all contact points.

    Fields on Gamma_C are P1 functions on the whole mesh, zero off Gamma_C.  A body without contact
    has no contact points and no contact facets: both tables are empty.
    """

    parameters: Parameters
    domain: Domain
    displacement: fem.Function  # P1, vector
    strain_norm: fem.Function  # P0, |eps(u)|
    locking_limit: fem.Function  # P0, M
    locked: fem.Function  # P0, 1 where |eps| >= M (1 - 1e-6), else 0
    elastic_stress: fem.Function  # P0, (d, d): A eps(u)
    locking_stress: fem.Function  # P0, (d, d): Z
    error_indicator: fem.Function  # P0, eta_K, the error in h by stress recovery
    contact_pressure: fem.Function  # P1, -sigma_nu >= 0
    smoothed_stress: fem.Function  # P1, R sigma_nu
    tangential_traction: fem.Function  # P1, vector, sigma_tau
    contact_state: fem.Function  # P1, OPEN, STICK or SLIP
    friction_bound: fem.Function  # P1, mu |R sigma_nu|
    contacts: tuple[ContactFields, ...]  # the nodal fields of each contact, on every rank
    contact_points: ContactPoints | None  # None on the ranks other than 0
    contact_facets: IntArray | None  # (m, d), corners as numbers of the points; None likewise
    summary: dict[str, Any] = field(default_factory=dict)

    @property
    def converged(self) -> bool:
        return bool(self.summary["converged"])
