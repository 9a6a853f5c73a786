"""Features of the user's data between the points at which the problem uses them.

The problem takes an expression at nodes, at midpoints of cells, or at points of a quadrature rule.
Here the expression is sampled at many more points inside of each cell or facet, so that narrow
features, jumps and poles are told.  A feature that is narrower than the distance of these points
may still be missed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import basix
import numpy as np

from contact_locking import _compat
from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.mesh.cell_kind import CellKind
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import agree, maximum
from contact_locking.values.value import Value

#: The values (k,) of data at points (k, d), NaN or infinite where there are none.
Values = Callable[[FloatArray], FloatArray]

# All entities together have about so many points, and so many are in memory at a time.
_POINTS, _CHUNK = 400_000, 200_000
# An entity is halved so many times at most: 128 parts of an edge, 1024 of a triangle, 512 of a
# tetrahedron.
_MOST_HALVINGS = {1: 7, 2: 5, 3: 3}
# Inside of an entity data may differ from an affine function by this share of their size.
_BENDS = 0.2
# Data that change by less than this share of their size do so by rounding.
_ROUNDING = 1e-12
# A pole is looked for in so many entities, which are halved around the largest value so often.
_SUSPECTS, _ZOOMS = 8, 30
# Data that grow faster than with this power of the inverse distance have a pole; the powers of a
# pole as 1/x, of a logarithm and of a square root are 1, 0 and 1/2.
_POLE = 0.9
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
    """The cells or facets of a kind of a rank on which data are given, each on one rank only.

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
        own = local[(local if dim == domain.dim else domain.owners(local)) < count]
        nodes = (
            _compat.cell_corners(mesh)[own]
            if dim == domain.dim
            else _compat.entities_to_geometry(mesh, dim, own)
        )
        kind = domain.kind if dim == domain.dim else domain.kind.facet
        simplices = kind.split(nodes.reshape(len(own), kind.corners))
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
    **more: Any,
) -> list[str]:
    """A warning about data with features that the points in use do not see; collective.

    The points in use are the corners of facets and the midpoints of cells.  Data that are affine
    inside of an entity are seen.  Deviations are ``relative_to`` the largest size of the data in
    the entity (``each``), in all entities (``all``), or to the range of the data (``range``).
    ``times`` are those of the sampling, and ``more`` are values of further variables.  Raises
    InputError for a pole.
    """
    if value.expression is None or value.is_constant:
        return []
    for time in times if value.is_timed else times[:1]:

        def values(x: FloatArray, time: float = time) -> FloatArray:
            return value.unchecked(x.T, time, **more)

        if found := _features(entities, values, key, advice, relative_to):
            return found
    return []


def _features(
    entities: Entities, values: Values, key: str, advice: str, relative_to: str
) -> list[str]:
    comm, dim = entities.domain.comm, entities.dim
    inner, _ = rule(dim, entities.halvings, 1)
    # The residual of a fit by an affine function.
    left = np.eye(len(inner)) - inner @ np.linalg.pinv(inner)
    used = rule(dim, 0, 1)[0] if entities.name == "cell" else np.eye(dim + 1)
    count = len(entities.corners)
    low, high, sizes, bend = np.zeros((4, count))
    ends = [np.inf, -np.inf]
    place = np.zeros((count, entities.domain.dim))
    with np.errstate(all="ignore"):
        for chunk, x in entities.chunks(np.vstack([inner, used])):
            both = values(x.reshape(-1, x.shape[2])).reshape(x.shape[:2])
            given, at_used = both[:, : len(inner)], _filled(both[:, len(inner) :])
            found = _filled(given)
            given = np.where(np.isnan(given), found, given)
            low[chunk], high[chunk] = given.min(axis=1), given.max(axis=1)
            sizes[chunk] = np.abs(found).max(axis=1)
            rest = np.abs(found @ left)
            bend[chunk] = rest.max(axis=1)
            place[chunk] = x[np.arange(len(x)), rest.argmax(axis=1)]
            ends = [at_used.min(initial=ends[0]), at_used.max(initial=ends[1])]
    least = -maximum(comm, -np.minimum(low, ends[0]), -np.inf)
    most = maximum(comm, np.maximum(high, ends[1]), -np.inf)
    size = most - least if relative_to == "range" else max(abs(least), abs(most))
    if relative_to == "range" and size <= _ROUNDING * max(abs(least), abs(most)):
        return []
    share = bend / np.maximum(sizes if relative_to == "each" else size, 1e-300)
    suspects = np.argsort(-share, kind="stable")[:_SUSPECTS].astype(np.int32)
    suspects = suspects[share[suspects] > _BENDS]
    agree(comm, lambda: refuse_poles(entities, suspects, values, key))
    worst = int(np.argmax(share)) if count else 0
    mine = (0.0, "", 0.0, 0.0)
    if count:
        mine = (share[worst], entities.domain.where(place[worst]), low[worst], high[worst])
    top = max(comm.allgather(mine))
    if top[0] > _BENDS:
        return [
            f"{key}: changes from {top[2]:.3g} to {top[3]:.3g} inside a {entities.name} near "
            f"{top[1]}, where the mesh sees it at few points only; {advice}"
        ]
    return []


def _filled(found: FloatArray) -> FloatArray:
    """Values (k, q) where those that are no numbers, as 0/0, are the mean of their entity.

    Infinite values, as of a limit that is none, are larger than all others.
    """
    finite = np.isfinite(found)
    if np.all(finite):
        return found
    most = np.abs(np.where(finite, found, 0.0)).max(initial=1.0)
    found = np.clip(found, -10.0 * most, 10.0 * most)
    counted = np.isfinite(found)
    count = np.maximum(np.sum(counted, axis=1, keepdims=True), 1)
    means = np.sum(np.where(counted, found, 0.0), axis=1, keepdims=True) / count
    return np.where(counted, found, means)


def refuse_poles(entities: Entities, suspects: IndexArray, values: Values, key: str) -> None:
    """Raise InputError for data that grow without bound in some of the entities; not collective.

    Each entity is halved again and again around the point with the largest value.
    """
    if not len(suspects):
        return
    dim = entities.dim
    lattice, _ = rule(dim, 4 if dim == 1 else 3 if dim == 2 else 2, 1)
    lattice = lattice - 1.0 / (dim + 1)
    corners = entities.corners[suspects]
    centre = np.full((len(corners), dim + 1), 1.0 / (dim + 1))
    sizes = np.zeros((_ZOOMS, len(corners)))
    for zoom in range(_ZOOMS):
        shares = centre[:, None] + 0.5**zoom * lattice
        x = np.einsum("kqc,kcd->kqd", shares, corners)
        found = np.abs(values(x.reshape(-1, x.shape[2])).reshape(x.shape[:2]))
        found[(shares.min(axis=2) < 0.0) | ~np.isfinite(found)] = -1.0
        best = np.argmax(found, axis=1)
        rows = np.arange(len(corners))
        sizes[zoom], centre = found[rows, best], shares[rows, best]
    third = _ZOOMS // 3
    start, end = np.maximum(sizes[third], 1e-300), np.maximum(sizes[-1], 1e-300)
    powers = np.log2(end / start) / (_ZOOMS - 1 - third)
    worst = int(np.argmax(powers))
    if powers[worst] > _POLE:
        where = entities.domain.where(centre[worst] @ corners[worst])
        raise InputError(
            f"grows without bound near {where}, as at a pole; give an expression that stays "
            "finite, as with min or max",
            key,
        )
