"""The material of a study file: elasticity and limits of the strain, region by region."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from contact_locking.arrays import AXES, FloatArray, IndexArray
from contact_locking.expressions import parse
from contact_locking.fields.clock import Clock
from contact_locking.fields.sampling import Entities, features
from contact_locking.fields.values import PresentValue, evaluate
from contact_locking.laws import elasticity as law
from contact_locking.mesh.domain import Domain
from contact_locking.problem.elasticity import Elasticity, require_symmetric
from contact_locking.problem.limits import (
    Deviator,
    Direction,
    LargestPrincipal,
    Limit,
    StrainBall,
    Volume,
    Weighted,
    require_positive,
)
from contact_locking.problem.points import Points
from contact_locking.study_file.parameters import (
    Eigenstrain,
    MaterialParameters,
    Region,
    StrainLimit,
)
from contact_locking.study_file.parameters import Elasticity as ElasticityParameters

_ADVICE_ON_CELLS = "refine the mesh there, or let a boundary of the region in its on go there"


@dataclass(frozen=True)
class _EigenstrainPart:
    """Entries (i, j) of the tensor in some cells, times a temperature if there is one."""

    cells: IndexArray
    entries: dict[tuple[int, int], PresentValue]
    temperature: PresentValue | None

    @property
    def values(self) -> list[PresentValue]:
        rest = () if self.temperature is None else (self.temperature,)
        return [*dict.fromkeys(self.entries.values()), *rest]

    def at(self, points: FloatArray) -> FloatArray:
        """The tensors (k, 3, 3) at points (d, k); collective."""
        found = np.zeros((points.shape[1], 3, 3))
        known = {value: value(points) for value in dict.fromkeys(self.entries.values())}
        for (i, j), value in self.entries.items():
            found[:, i, j] = known[value]
        if self.temperature is not None:
            found *= self.temperature(points)[:, None, None]
        return found


class EigenstrainOfStudy:
    """``eps_0`` (k, 3, 3) at points of the strains: the sum of all entries of a study file.

    ``regions`` are the cells of the entries on a part of the body, where the stress may jump.  The
    constructor is collective and raises InputError for a region that the mesh does not have.
    """

    def __init__(self, domain: Domain, given: MaterialParameters, clock: Clock) -> None:
        self._domain, self._clock = domain, clock
        index_map = domain.mesh.topology.index_map(domain.dim)
        everywhere = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        self.regions: list[IndexArray] = []
        self._parts: list[_EigenstrainPart] = []
        for place, item in given.eigenstrains:
            key = ".".join(map(str, ("material", *place)))
            cells: IndexArray = everywhere
            if item.on is not None:
                found = [domain.cells(name, f"{key}.on") for name in item.on]
                cells = np.asarray(np.unique(np.concatenate(found)), dtype=np.int32)
                self.regions.append(cells)
            self._parts.append(self._part(cells, item, key))

    def _part(self, cells: IndexArray, item: Eigenstrain, key: str) -> _EigenstrainPart:
        name, tensor = item.tensor

        def value(given: float | str, place: str) -> PresentValue:
            return PresentValue(self._domain.comm, given, f"{key}.{place}", self._clock)

        warm = None if item.temperature is None else value(item.temperature, "temperature")
        if not isinstance(tensor, tuple):
            alike = value(tensor, name)
            return _EigenstrainPart(cells, {(i, i): alike for i in range(3)}, warm)
        entries = {place: value(one, told) for place, one, told in _entries(tensor, name)}
        return _EigenstrainPart(cells, entries, warm)

    def at(self, points: Points) -> FloatArray:
        """The values (k, 3, 3) at the present time; collective."""
        found = np.zeros((len(points.all), 3, 3))
        for part in self._parts:
            inside = points.of(part.cells)
            found[inside] += part.at(points.places[:, inside])
        return found

    def warnings(self) -> list[str]:
        """The part of the data that the points of the strains do not see; collective."""
        told = []
        for part in self._parts:
            inside = Entities.of(self._domain, self._domain.dim, part.cells)
            for value in part.values:
                if not value.expression.is_constant:
                    times = self._clock.some_times
                    told += features(
                        inside, value.expression, value.key, _ADVICE_ON_CELLS, times=times
                    )
        return told


def _entries(tensor: tuple[Any, ...], name: str) -> Iterator[tuple[tuple[int, int], Any, str]]:
    for i, row in enumerate(tensor):
        if isinstance(row, tuple):
            for j, one in enumerate(row):
                yield (i, j), one, f"{name}.{i}.{j}"
        else:
            yield (i, i), row, f"{name}.{i}"


_ADVICE = "refine the mesh there, or let a boundary of material.regions go there"
Scalar = float | str


@dataclass(frozen=True)
class Piece:
    """A number or an expression of x, y[, z] in some local cells."""

    cells: IndexArray
    value: Scalar
    key: str

    def at(self, points: Points, infinite: bool = False) -> FloatArray:
        """The values at the points in the cells; collective.

        Raises InputError for a value that is not finite, unless it may be ``infinite``.
        """
        places = points.places[:, points.of(self.cells)]
        return evaluate(points.domain.comm, self.value, places, self.key, infinite)

    def warnings(self, domain: Domain, infinite: bool = False) -> list[str]:
        """Features of an expression between the points; collective.  Raises for a pole."""
        expression = parse(self.value, AXES, allow_infinite=infinite)
        if expression.is_constant:
            return []
        inside = Entities.of(domain, domain.dim, self.cells)
        return features(inside, expression, self.key, _ADVICE, relative_to="each")


@dataclass(frozen=True)
class Bounds:
    """Limits of the strain in pieces, of which the last counts, and infinity elsewhere.

    Each is positive times ``sign``; ``requirement`` names the positive number in messages.
    """

    pieces: Sequence[Piece]
    requirement: str
    sign: float = 1.0

    def at(self, points: Points) -> FloatArray:
        """The limits (k,); collective.  Raises InputError for one that is not positive."""
        found = np.full(len(points.all), self.sign * math.inf)
        for piece in self.pieces:
            values = piece.at(points, infinite=True)
            require_positive(points.domain, self.sign * values, piece.key, self.requirement)
            found[points.of(piece.cells)] = values
        return found


@dataclass(frozen=True)
class Entries:
    """Vectors or matrices in cells, by the pieces of their entries, and zero elsewhere."""

    entries: Sequence[tuple[tuple[int, ...], Piece]]
    shape: tuple[int, ...]

    def at(self, points: Points) -> FloatArray:
        """The values (k, ...); collective."""
        found = np.zeros((len(points.all), *self.shape))
        for place, piece in self.entries:
            where: Any = (points.of(piece.cells), *place)
            found[where] = piece.at(points)
        return found


class MaterialOfStudy:
    """The elasticity, the limits of the strain and the regions that a study file describes.

    ``regions`` are the cells of each region of the material, and of each eigenstrain on a part of
    the body.  The constructor is collective and raises InputError for a region that the mesh does
    not have.
    """

    def __init__(self, domain: Domain, given: MaterialParameters, clock: Clock) -> None:
        self._domain, self._given = domain, given
        index_map = domain.mesh.topology.index_map(domain.dim)
        self._all = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        self._cells = {
            name: domain.cells(name, f"material.regions.{name}") for name in given.regions
        }
        self.regions = [self._cells[name] for name in sorted(given.regions)]
        self._pieces: list[tuple[Piece, bool]] = []
        self._eigenstrain: EigenstrainOfStudy | None = None
        if given.eigenstrains:
            self._eigenstrain = EigenstrainOfStudy(domain, given, clock)
            self.regions += self._eigenstrain.regions
        self.elasticity = self._elasticity()
        self.limits = self._limits()

    def warnings(self) -> list[str]:
        """Features of the data between the points of the strains; collective."""
        found = [piece.warnings(self._domain, infinite) for piece, infinite in self._pieces]
        eigen = [] if self._eigenstrain is None else self._eigenstrain.warnings()
        return [*(text for texts in found for text in texts), *eigen]

    def _piece(self, cells: IndexArray, value: Scalar, key: str, infinite: bool = False) -> Piece:
        piece = Piece(cells, value, key)
        self._pieces.append((piece, infinite))
        return piece

    def _elasticity(self) -> Elasticity:
        given, place = self._given, "material.elasticity"
        sections: list[tuple[IndexArray, ElasticityParameters, str]] = [
            (self._all, given.elasticity, place)
        ]
        for name, region in given.regions.items():
            if region.elasticity is not None:
                key = f"material.regions.{name}.elasticity"
                sections.append((self._cells[name], region.elasticity, key))
        parts = [self._part(*section) for section in sections]
        found = partial(
            Elasticity, eigenstrain=self._eigenstrain, plane=given.plane, key=parts[-1].key
        )
        if any(isinstance(part, _AnisotropicPart) for part in parts):
            return found(stiffness=_Stiffness(parts))
        moduli = [part for part in parts if isinstance(part, _IsotropicPart)]
        first, second = (_Lame(moduli, number) for number in (0, 1))
        return found(lame_lambda=first, lame_mu=second)

    def _part(self, cells: IndexArray, given: ElasticityParameters, key: str) -> _Part:
        if given.stiffness is not None:
            rows = enumerate(given.stiffness)
            entries = [
                ((i, j), self._piece(cells, entry, f"{key}.stiffness"))
                for i, row in rows
                for j, entry in enumerate(row)
            ]
            return _AnisotropicPart(cells, key, entries)
        names = ("young", "poisson") if given.young is not None else ("lambda", "mu")
        values = (given.young, given.poisson)
        if given.young is None:
            values = (given.lame_lambda, given.lame_mu)
        pieces = []
        for name, value in zip(names, values, strict=True):
            assert value is not None
            pieces.append(self._piece(cells, value, f"{key}.{name}"))
        return _IsotropicPart(cells, key, pieces, given.young is not None)

    def _limits(self) -> list[Limit]:
        """All limits: those of one norm, of several regions, are one set."""
        limits: list[Limit] = [StrainBall(self._bounds(list(self._balls()), "the locking limit"))]
        shape, upper, lower, principal = [], [], [], []
        along: list[Limit] = []
        for limit, cells, key in self._other_limits():
            name = key.partition(".")[2]
            most = self._piece(cells, limit.upper, f"{key}.at_most", infinite=True)
            few = []
            if limit.lower != -math.inf:
                few.append(self._piece(cells, limit.lower, f"{key}.at_least"))
            match limit.norm:
                case "deviator":
                    shape.append(most)
                case "largest_principal":
                    principal.append(most)
                case "volume":
                    upper.append(most)
                    lower += few
                case "direction":
                    bounds = self._bounds([most], "the limit"), self._lower(few)
                    vector = self._vector(limit, cells, key)
                    along.append(Direction(vector, *bounds, name, key))
                case "weighted":
                    assert limit.matrix is not None
                    size = len(limit.matrix)
                    entries = [
                        ((i, j), self._piece(cells, entry, f"{key}.matrix.{i}.{j}"))
                        for i, row in enumerate(limit.matrix)
                        for j, entry in enumerate(row)
                    ]
                    matrix = Entries(entries, (size, size))
                    along.append(Weighted(matrix, self._bounds([most], "the limit"), name, key))
        if shape:
            limits.append(Deviator(self._bounds(shape, "the limit")))
        if principal:
            limits.append(LargestPrincipal(self._bounds(principal, "the limit")))
        if upper or lower:
            limits.append(Volume(self._bounds(upper, "the limit"), self._lower(lower)))
        return [*limits, *along]

    def _bounds(self, pieces: Sequence[Piece], requirement: str) -> Bounds:
        return Bounds(pieces, requirement)

    def _lower(self, pieces: Sequence[Piece]) -> Bounds:
        return Bounds(pieces, "minus the lower limit", -1.0)

    def _vector(self, limit: StrainLimit, cells: IndexArray, key: str) -> Entries:
        assert limit.along is not None
        # The hoop component of an axisymmetric body may be left out.
        size = self._domain.kinematics.tensor_size(self._domain.dim)
        entries = [
            ((axis,), self._piece(cells, component, f"{key}.along.{axis}"))
            for axis, component in enumerate(limit.along)
        ]
        return Entries(entries, (size,))

    def _balls(self) -> Iterator[Piece]:
        """M of the ball: that of the body, and those of the regions with limits of their own."""
        yield self._piece(self._all, *_ball(self._given, "material"), infinite=True)
        for name, region in self._given.regions.items():
            if region.limits is not None:
                ball = _ball(region, f"material.regions.{name}")
                yield self._piece(self._cells[name], *ball, infinite=True)

    def _other_limits(self) -> Iterator[tuple[StrainLimit, IndexArray, str]]:
        """Every limit but balls, the cells that it belongs to, and its key."""
        sections = [(self._given.limits, "material.locking")]
        owner = np.zeros(len(self._all), dtype=np.int32)
        for name, region in self._given.regions.items():
            if region.limits is not None:
                owner[self._cells[name]] = len(sections)
                sections.append((region.limits, f"material.regions.{name}.locking"))
        for number, (limits, key) in enumerate(sections):
            cells = np.flatnonzero(owner == number).astype(np.int32)
            for index, limit in enumerate(limits):
                if limit.norm != "strain":
                    yield limit, cells, f"{key}.{index}"


def _ball(given: MaterialParameters | Region, place: str) -> tuple[Scalar, str]:
    """M of the ball among the limits of a section, inf without a ball, and its key."""
    for index, limit in enumerate(given.locking or ()):
        if limit.norm == "strain":
            return limit.upper, f"{place}.locking.{index}.at_most"
    short = given.locking_limit
    return math.inf if short is None else short, f"{place}.locking_limit"


@dataclass(frozen=True)
class _IsotropicPart:
    """Isotropic elasticity in some cells, by E and nu if ``are_moduli``, else by lambda and mu."""

    cells: IndexArray
    key: str
    pieces: Sequence[Piece]
    are_moduli: bool

    def lame(self, points: Points) -> FloatArray:
        """Both Lame coefficients (2, k) at the points in the cells; collective."""
        first, second = (piece.at(points) for piece in self.pieces)
        return np.array(law.lame_from_young(first, second) if self.are_moduli else (first, second))

    def stiffness(self, points: Points) -> FloatArray:
        """Mandel matrices (k, s, s) at the points in the cells; collective."""
        domain = points.domain
        pairs = domain.kinematics.mandel_pairs(domain.dim)
        first, second = self.lame(points)
        return law.isotropic_stiffness(first, second, domain.dim, pairs)


@dataclass(frozen=True)
class _AnisotropicPart:
    """Mandel matrices in some cells."""

    cells: IndexArray
    key: str
    entries: Sequence[tuple[tuple[int, int], Piece]]

    def stiffness(self, points: Points) -> FloatArray:
        """Mandel matrices (k, s, s) at the points in the cells; collective."""
        size = math.isqrt(len(self.entries))
        found = np.empty((len(points.of(self.cells)), size, size))
        for (i, j), piece in self.entries:
            found[:, i, j] = piece.at(points)
        require_symmetric(points.domain, found, f"{self.key}.stiffness")
        return found


_Part = _IsotropicPart | _AnisotropicPart


@dataclass(frozen=True)
class _Lame:
    """lambda or mu of parts, of which the last counts."""

    parts: Sequence[_IsotropicPart]
    number: int

    def at(self, points: Points) -> FloatArray:
        found = np.empty(len(points.all))
        for part in self.parts:
            found[points.of(part.cells)] = part.lame(points)[self.number]
        return found


@dataclass(frozen=True)
class _Stiffness:
    """Mandel matrices of parts, of which the last counts."""

    parts: Sequence[_Part]

    def at(self, points: Points) -> FloatArray:
        domain = points.domain
        size = len(domain.kinematics.mandel_pairs(domain.dim))
        found = np.empty((len(points.all), size, size))
        for part in self.parts:
            found[points.of(part.cells)] = part.stiffness(points)
        return found
