"""Data on a mesh: their values at present, at points and in UFL, and features between the points.

The problem takes an expression at nodes, at midpoints of cells, or at points of a quadrature rule.
:func:`features` samples the expression at many more points inside of each cell or facet, so that
narrow features, jumps and poles are reported.  A feature that is narrower than the distance of
these points may still be missed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import basix
import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking import _compat
from contact_locking.arrays import AXES, FloatArray, IndexArray
from contact_locking.errors import InputError, with_key
from contact_locking.expressions import TIME, Lookup
from contact_locking.findings import Finding
from contact_locking.mesh.data import CellKind, lagrange, nodal_functions
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import agree, maximum
from contact_locking.values.value import Value

#: The values (k,) of data at points (k, d), NaN or infinite where there are none.
Values = Callable[[FloatArray], FloatArray]

# The most sampling points of all entities together, and the most in memory at a time.
_POINTS, _CHUNK = 400_000, 200_000
# The most halvings of an entity by its dimension: into 128 parts of an edge, 1024 of a triangle,
# 512 of a tetrahedron.
_MOST_HALVINGS = {1: 7, 2: 5, 3: 3}
# Inside of an entity data may differ from an affine function by this share of their size.
_BENDS = 0.2
# Data that change by less than this share of their size do so by rounding.
_ROUNDING = 1e-12
_CELLS = {1: basix.CellType.interval, 2: basix.CellType.triangle, 3: basix.CellType.tetrahedron}
# The corners of the children of a simplex, each the midpoint between two corners of the simplex.
_CHILDREN = {
    1: ("00 01", "01 11"),
    2: ("00 01 02", "01 11 12", "02 12 22", "01 02 12"),
    3: (
        *("00 01 02 03", "01 11 12 13", "02 12 22 23", "03 13 23 33"),
        *("01 02 03 13", "01 02 12 13", "02 03 13 23", "02 12 13 23"),
    ),
}


@cache
def rule(dim: int, halvings: int, degree: int) -> tuple[FloatArray, FloatArray]:
    """Barycentric points (q, dim + 1) and weights (q,), with the sum 1, in the parts of a simplex.

    The simplex is halved ``halvings`` times, and each part has the rule of the degree.
    """
    ends = np.array([[[int(c) for c in pair] for pair in row.split()] for row in _CHILDREN[dim]])
    parts = np.eye(dim + 1)[None]
    for _ in range(halvings):
        parts = 0.5 * (parts[:, ends[..., 0]] + parts[:, ends[..., 1]])
        parts = parts.reshape(-1, dim + 1, dim + 1)
    places, weights = basix.make_quadrature(_CELLS[dim], degree)
    shares = np.column_stack([1.0 - places.sum(axis=1), places])
    points = np.einsum("qc,pcb->pqb", shares, parts).reshape(-1, dim + 1)
    return points, np.tile(weights / weights.sum(), len(parts)) / len(parts)


@dataclass(frozen=True)
class Entities:
    """The owned cells or facets on which data act.

    They are n simplices: boxes are divided.  ``corners`` (n, dim + 1, d) are their corners, and
    ``sizes`` (n,) their lengths, areas or volumes.  ``halvings`` says how often a simplex is halved
    for the points inside.
    """

    domain: Domain
    kind: CellKind
    corners: FloatArray
    sizes: FloatArray
    halvings: int

    @classmethod
    def of(cls, domain: Domain, dim: int, local: IndexArray) -> Entities:
        """The entities of a dimension with local numbers, ghosts left out; collective."""
        mesh, count = domain.mesh, domain.mesh.topology.index_map(domain.dim).size_local
        owned = local[(local if dim == domain.dim else domain.owners(local)) < count]
        nodes = (
            _compat.cell_corners(mesh)[owned]
            if dim == domain.dim
            else _compat.entities_to_geometry(mesh, dim, owned)
        )
        kind = domain.kind if dim == domain.dim else domain.kind.facet
        simplices = kind.split(nodes.reshape(len(owned), kind.corners))
        corners = mesh.geometry.x[:, : domain.dim][simplices]
        edges = corners[:, 1:] - corners[:, :1]
        sizes = np.sqrt(np.linalg.det(edges @ np.swapaxes(edges, 1, 2)))
        total = domain.comm.allreduce(len(simplices))
        room = max(_POINTS // max(total, 1), 1)
        halvings = min(int(np.log2(room)) // dim, _MOST_HALVINGS[dim])
        return cls(domain, kind, corners, sizes, halvings)

    @property
    def dim(self) -> int:
        return self.kind.dim

    def reference_rule(self, halvings: int, degree: int) -> tuple[FloatArray, FloatArray]:
        """`rule` in the whole reference cell: points (q, dim) and weights (q,)."""
        shares, weights = rule(self.dim, halvings, degree)
        parts = self.kind.places[np.array(self.kind.simplices)]
        points = np.einsum("qc,pcd->pqd", shares, parts).reshape(-1, self.dim)
        return points, np.tile(weights * self.kind.measure / len(parts), len(parts))

    @property
    def name(self) -> str:
        """The kind of the entities, in words."""
        return "cell" if self.dim == self.domain.dim else "facet"

    def chunks(self, shares: FloatArray) -> Iterator[tuple[slice, FloatArray]]:
        """Some entities at a time, with their points (m, q, d) of barycentric coordinates."""
        step = max(_CHUNK // len(shares), 1)
        for start in range(0, len(self.corners), step):
            chunk = slice(start, start + step)
            yield chunk, np.einsum("qc,kcd->kqd", shares, self.corners[chunk])


def features(
    entities: Entities,
    value: Value,
    key: str,
    advice: str,
    relative_to: str = "all",
    times: Sequence[float] = (0.0,),
    **variables: Any,
) -> list[Finding]:
    """The finding about data with features that the points in use do not see; collective.

    The points in use are the corners of facets and the midpoints of cells.  Data that are affine
    inside of an entity are seen.  Deviations are ``relative_to`` the largest size of the data in
    the entity (``each``), in all entities (``all``), or to the range of the data (``range``).
    ``times`` are those of the sampling, and ``variables`` are values of further variables.
    """
    if value.expression is None or value.is_constant:
        return []
    for time in times if value.is_timed else times[:1]:

        def values(x: FloatArray, time: float = time) -> FloatArray:
            return value.unchecked(x.T, time, **variables)

        if findings := _features(entities, values, key, advice, relative_to):
            return findings
    return []


def _features(
    entities: Entities, values: Values, key: str, advice: str, relative_to: str
) -> list[Finding]:
    comm, dim = entities.domain.comm, entities.dim
    inner, _ = rule(dim, entities.halvings, 1)
    # The residual of a fit by an affine function.
    residual = np.eye(len(inner)) - inner @ np.linalg.pinv(inner)
    used = rule(dim, 0, 1)[0] if entities.name == "cell" else np.eye(dim + 1)
    count = len(entities.corners)
    low, high, sizes, bend = np.zeros((4, count))
    ends = [np.inf, -np.inf]
    place = np.zeros((count, entities.domain.dim))
    with np.errstate(all="ignore"):
        for chunk, x in entities.chunks(np.vstack([inner, used])):
            both = values(x.reshape(-1, x.shape[2])).reshape(x.shape[:2])
            inside, at_used = both[:, : len(inner)], _filled(both[:, len(inner) :])
            filled = _filled(inside)
            inside = np.where(np.isnan(inside), filled, inside)
            low[chunk], high[chunk] = inside.min(axis=1), inside.max(axis=1)
            sizes[chunk] = np.abs(filled).max(axis=1)
            deviation = np.abs(filled @ residual)
            bend[chunk] = deviation.max(axis=1)
            place[chunk] = x[np.arange(len(x)), deviation.argmax(axis=1)]
            ends = [at_used.min(initial=ends[0]), at_used.max(initial=ends[1])]
    least = -maximum(comm, -np.minimum(low, ends[0]), -np.inf)
    most = maximum(comm, np.maximum(high, ends[1]), -np.inf)
    size = most - least if relative_to == "range" else max(abs(least), abs(most))
    if relative_to == "range" and size <= _ROUNDING * max(abs(least), abs(most)):
        return []
    share = bend / np.maximum(sizes if relative_to == "each" else size, 1e-300)
    worst = int(np.argmax(share)) if count else 0
    mine = (0.0, "", 0.0, 0.0)
    if count:
        mine = (share[worst], entities.domain.where(place[worst]), low[worst], high[worst])
    bent, at, smallest, largest = max(comm.allgather(mine))
    if bent <= _BENDS:
        return []
    about: dict[str, Any] = {"entity": entities.name, "place": at, "advice": advice}
    return [Finding("data.features", key, low=float(smallest), high=float(largest), **about)]


def _filled(values: FloatArray) -> FloatArray:
    """Values (k, q) where those that are no numbers, as 0/0, are the mean of their entity.

    Infinite values, as of a limit that is none, are larger than all others.
    """
    finite = np.isfinite(values)
    if np.all(finite):
        return values
    most = np.abs(np.where(finite, values, 0.0)).max(initial=1.0)
    values = np.clip(values, -10.0 * most, 10.0 * most)
    counted = np.isfinite(values)
    count = np.maximum(np.sum(counted, axis=1, keepdims=True), 1)
    means = np.sum(np.where(counted, values, 0.0), axis=1, keepdims=True) / count
    return np.where(counted, values, means)


_HIDDEN = 1e-12
# The number of times of a process at which data are sampled, the first and the last among them.
_TIMES = 8
_UP_TO_ONE = [number / _TIMES for number in range(_TIMES + 1)]
# By the number of corners.
_SIMPLICES = {2: "interval", 3: "triangle", 4: "tetrahedron"}


class Clock:
    """The time t on a mesh: ``now`` for values at points, ``constant`` for the forms.

    ``planned`` are the times of a process, which begins at 0 or at the first of them.
    ``some_times`` are some of these, at which data are sampled; without planned times, as in a
    script, times up to t = 1.
    """

    def __init__(self, mesh: dolfinx.mesh.Mesh, planned: Sequence[float] = ()) -> None:
        self.mesh, self.planned = mesh, tuple(planned)
        first = float(planned[0]) if planned else 0.0
        places = np.linspace(0, len(planned) - 1, min(len(planned), _TIMES))
        self.some_times = [planned[round(place)] for place in places] or _UP_TO_ONE
        self.constant = fem.Constant(mesh, first)

    @property
    def now(self) -> float:
        return float(self.constant.value)

    def set(self, time: float) -> None:
        self.constant.value = time


class LargestSoFar:
    """The largest size that a quantity has had at any time so far.

    A size below 1e-12 of the largest is zero with rounding, as that of sin(pi*t) is at t = 1.
    """

    def __init__(self) -> None:
        self._most = 0.0

    def hides(self, size: float) -> bool:
        """Whether the present ``size`` >= 0, which counts from now on, is zero with rounding."""
        self._most = max(self._most, size)
        return size <= _HIDDEN * self._most < np.inf


class PresentValue:
    """A value on the mesh of a clock, at its time.

    ``key`` names it in messages.  Calls give the values (k, ...) of the ``shape`` at points (d, k);
    those that are small beside those of earlier times are zero with rounding, and then all are
    zero.  All methods are collective.  The constructor raises InputError for a coordinate that the
    mesh does not have, and a call for a value that is no number.
    """

    def __init__(self, value: Value, key: str, clock: Clock, shape: tuple[int, ...] = ()) -> None:
        self.value, self.key, self.clock, self._shape = value, key, clock, shape
        self._so_far = LargestSoFar()
        # The coefficient in UFL of each table, or of a function of points.
        self._coefficients: dict[Any, fem.Constant | fem.Function] = {}
        self._degree = 1
        names = frozenset[str]() if value.expression is None else value.expression.names
        for unknown in names.intersection(AXES[clock.mesh.geometry.dim :]):
            raise InputError(f"unknown name '{unknown}' in the expression '{value}'", key)

    def __call__(self, x: FloatArray) -> FloatArray:
        comm = self.clock.mesh.comm

        def values() -> FloatArray:
            present = self.value.at(x, self.clock.now, self._shape)
            if np.isnan(present).any():
                raise InputError("is not a number somewhere")
            return present

        present = agree(comm, lambda: with_key(self.key, values))
        is_zero = self.value.is_timed and self._so_far.hides(maximum(comm, np.abs(present)))
        return np.zeros_like(present) if is_zero else present

    def ufl(self, degree: int) -> Expr:
        """The value in UFL.

        A table over coordinates, and a function of points, count by their values at the nodes of
        the ``degree``; see :meth:`refresh`.
        """
        value, mesh = self.value, self.clock.mesh
        if value.number is not None:
            return fem.Constant(mesh, value.number)
        self._degree = degree
        if value.expression is None:
            data = getattr(value.data, "ufl", value.data)
            if not isinstance(data, Expr):
                data = self._coefficients[value] = self._nodal()
                self.refresh()
            return data
        x = ufl.SpatialCoordinate(mesh)
        places: dict[str, Any] = {axis: x[i] for i, axis in enumerate(AXES[: mesh.geometry.dim])}
        for table in value.expression.lookups:
            is_number = table.names <= {TIME}
            self._coefficients[table] = fem.Constant(mesh, 0.0) if is_number else self._nodal()
        self.refresh()
        places[TIME] = self.clock.constant
        return value.expression.ufl(self._coefficients, **places)

    def refresh(self) -> None:
        """Update the coefficients that represent tables and functions in UFL to the present time.

        The nodal values outside of a table are those of its end: a cell on the boundary has nodes
        where a load does not act.
        """
        now = self.clock.now
        for data, coefficient in self._coefficients.items():
            if isinstance(coefficient, fem.Constant):
                coefficient.value = data.table.clamped(data.argument_at(**{TIME: now}))
            else:
                coefficient.interpolate(partial(self._at, data, time=now))

    @property
    def is_nodal(self) -> bool:
        """Whether a table counts by its values at nodes in UFL."""
        return any(
            isinstance(coefficient, fem.Function) for coefficient in self._coefficients.values()
        )

    def in_simplices(
        self, corners: FloatArray, shares: FloatArray, time: float
    ) -> dict[Lookup, FloatArray]:
        """The values (m * q,) of tables in UFL at points of m simplices with corners (m, c, d).

        ``shares`` (q, c) are the barycentric coordinates of the points.
        """
        cell = _SIMPLICES[shares.shape[1]]
        places = lagrange(cell, self._degree).points
        at_nodes = np.column_stack([1.0 - places.sum(axis=1), places])
        nodes = np.einsum("nc,mcd->dmn", at_nodes, corners)
        basis = nodal_functions(cell, self._degree, shares[:, 1:])
        return {
            table: np.einsum("qn,mn->mq", basis, self._at(table, nodes, time)).reshape(-1)
            for table, coefficient in self._coefficients.items()
            if isinstance(coefficient, fem.Function)
        }

    def _nodal(self) -> fem.Function:
        return fem.Function(fem.functionspace(self.clock.mesh, ("P", self._degree)))

    def _at(self, data: Value | Lookup, x: FloatArray, time: float) -> FloatArray:
        if isinstance(data, Value):
            return data.at(x[: self.clock.mesh.geometry.dim], time)
        places: dict[str, Any] = dict(zip(AXES, x, strict=False))
        return data.table.clamped(data.argument_at(**places, **{TIME: time})) + 0.0 * x[0]
