"""The material of a study file: elasticity and limits of the strain, region by region."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.fields.clock import Clock
from contact_locking.fields.sampling import Entities, features
from contact_locking.fields.values import PresentValue, evaluate
from contact_locking.laws import elasticity as law
from contact_locking.mesh.domain import Domain
from contact_locking.problem.elasticity import Elasticity, require_symmetric
from contact_locking.problem.limits import (
    Deviator,
    Direction,
    Limit,
    StrainBall,
    Volume,
    Weighted,
    require_positive,
)
from contact_locking.problem.points import Points
from contact_locking.study_file.parameters.material import (
    Eigenstrain,
    MaterialParameters,
    Region,
    StrainLimit,
)
from contact_locking.study_file.parameters.material import Elasticity as ElasticityParameters
from contact_locking.values.concept import Place, dotted, leaves
from contact_locking.values.value import Value

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

    def __init__(
        self, domain: Domain, given: MaterialParameters, clock: Clock, everywhere: IndexArray
    ) -> None:
        self._domain, self._clock = domain, clock
        self.regions: list[IndexArray] = []
        self._parts: list[_EigenstrainPart] = []
        for place, item in given.eigenstrains:
            key = dotted("material", *place)
            cells = everywhere
            if item.on is not None:
                found = [domain.cells(name, f"{key}.on") for name in item.on]
                cells = np.asarray(np.unique(np.concatenate(found)), dtype=np.int32)
                self.regions.append(cells)
            self._parts.append(self._part(cells, item, key))

    def _part(self, cells: IndexArray, item: Eigenstrain, key: str) -> _EigenstrainPart:
        def value(given: Value, *place: str | int) -> PresentValue:
            return PresentValue(self._domain.comm, given, dotted(key, *place), self._clock)

        name, tensor = item.tensor
        entries: dict[tuple[int, int], PresentValue] = {}
        for place, given in leaves(tensor, ()):
            one = value(given, name, *place)
            match place:
                case (int(i), int(j)):
                    entries[i, j] = one
                case _:  # a normal strain, or the number of all three
                    entries |= {(int(i), int(i)): one for i in place or range(3)}
        warm = None if item.temperature is None else value(item.temperature, "temperature")
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
                times = self._clock.some_times
                told += features(inside, value.value, value.key, _ADVICE_ON_CELLS, times=times)
        return told


_ADVICE = "refine the mesh there, or let a boundary of material.regions go there"


@dataclass(frozen=True)
class Piece:
    """A value in some local cells."""

    cells: IndexArray
    value: Value
    key: str

    def at(self, points: Points) -> FloatArray:
        """The values at the points in the cells; collective.  Raises InputError for another."""
        places = points.places[:, points.of(self.cells)]
        return evaluate(points.domain.comm, self.value, places, self.key)

    def warnings(self, domain: Domain) -> list[str]:
        """Features of an expression between the points; collective.  Raises for a pole."""
        if self.value.is_constant:
            return []
        inside = Entities.of(domain, domain.dim, self.cells)
        return features(inside, self.value, self.key, _ADVICE, relative_to="each")


@dataclass(frozen=True)
class Bounds:
    """Limits of the strain in pieces, and infinity elsewhere.

    Each is positive times ``sign``; ``requirement`` names the positive number in messages.
    """

    pieces: Sequence[Piece]
    requirement: str
    sign: float = 1.0

    def at(self, points: Points) -> FloatArray:
        """The limits (k,); collective.  Raises InputError for one that is not positive."""
        found = np.full(len(points.all), self.sign * math.inf)
        for piece in self.pieces:
            values = piece.at(points)
            require_positive(points.domain, self.sign * values, piece.key, self.requirement)
            found[points.of(piece.cells)] = values
        return found


@dataclass(frozen=True)
class Entries:
    """Vectors or matrices in cells, by the pieces of their entries, and zero elsewhere."""

    entries: Sequence[tuple[Place, Piece]]
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
        self._pieces: list[Piece] = []
        self._eigenstrain: EigenstrainOfStudy | None = None
        if given.eigenstrains:
            self._eigenstrain = EigenstrainOfStudy(domain, given, clock, self._all)
            self.regions += self._eigenstrain.regions
        self.elasticity = self._elasticity()
        self.limits = self._limits()

    def warnings(self) -> list[str]:
        """Features of the data between the points of the strains; collective."""
        found = [text for piece in self._pieces for text in piece.warnings(self._domain)]
        return found + ([] if self._eigenstrain is None else self._eigenstrain.warnings())

    def _piece(self, cells: IndexArray, value: Value, key: str) -> Piece:
        piece = Piece(cells, value, key)
        self._pieces.append(piece)
        return piece

    def _pieces_of(self, cells: IndexArray, tensor: Any, key: str) -> list[tuple[Place, Piece]]:
        """The entries of a vector or a matrix with their places."""
        return [
            (place, self._piece(cells, value, dotted(key, *place)))
            for place, value in leaves(tensor, ())
        ]

    def _elasticity(self) -> Elasticity:
        given = self._given
        parts = [self._part(self._all, given.elasticity, "material.elasticity")]
        for name, region in given.regions.items():
            if region.elasticity is not None:
                key = f"material.regions.{name}.elasticity"
                parts.append(self._part(self._cells[name], region.elasticity, key))
        found = partial(
            Elasticity, eigenstrain=self._eigenstrain, plane=given.plane, key=parts[-1].key
        )
        if any(part.is_matrix for part in parts):
            size = len(self._domain.kinematics.mandel_pairs(self._domain.dim))
            return found(stiffness=_InParts(parts, _Part.stiffness, (size, size)))
        return found(
            lame_lambda=_InParts(parts, lambda part, points: part.lame(points)[0]),
            lame_mu=_InParts(parts, lambda part, points: part.lame(points)[1]),
        )

    def _part(self, cells: IndexArray, given: ElasticityParameters, key: str) -> _Part:
        names = {"young": given.young, "poisson": given.poisson}
        names |= {"lambda": given.lame_lambda, "mu": given.lame_mu}
        pieces = [
            self._piece(cells, value, f"{key}.{name}")
            for name, value in names.items()
            if value is not None
        ]
        entries = self._pieces_of(cells, given.stiffness or (), f"{key}.stiffness")
        pieces += [piece for _, piece in entries]
        return _Part(cells, key, pieces, given.young is not None)

    def _limits(self) -> list[Limit]:
        """All limits: those of one norm, of several regions, are one set."""
        upper: dict[str, list[Piece]] = {}
        lower: list[Piece] = []
        along: list[Limit] = []
        size = self._domain.kinematics.tensor_size(self._domain.dim)
        for limit, cells, key, most_key in self._limits_in_cells():
            name = key.partition(".")[2]
            most = self._piece(cells, limit.upper, most_key)
            few = []
            if limit.lower != -math.inf:
                few.append(self._piece(cells, limit.lower, f"{key}.at_least"))
            if limit.along is not None:
                # The hoop component of an axisymmetric body may be left out.
                vector = Entries(self._pieces_of(cells, limit.along, f"{key}.along"), (size,))
                along.append(Direction(vector, _upper([most]), _lower(few), name, key))
            elif limit.matrix is not None:
                shape = (len(limit.matrix), len(limit.matrix))
                matrix = Entries(self._pieces_of(cells, limit.matrix, f"{key}.matrix"), shape)
                along.append(Weighted(matrix, _upper([most]), name, key))
            else:
                upper.setdefault(limit.norm, []).append(most)
                lower += few
        limits: list[Limit] = [StrainBall(Bounds(upper.get("strain", []), "the locking limit"))]
        if "deviator" in upper:
            limits.append(Deviator(_upper(upper["deviator"])))
        if "volume" in upper:
            limits.append(Volume(_upper(upper["volume"]), _lower(lower)))
        return [*limits, *along]

    def _limits_in_cells(self) -> Iterator[tuple[StrainLimit, IndexArray, str, str]]:
        """Every limit, the cells that it belongs to, its key, and that of its upper limit."""
        sections: list[tuple[MaterialParameters | Region, str]] = [(self._given, "material")]
        owner = np.zeros(len(self._all), dtype=np.int32)
        for name, region in self._given.regions.items():
            if region.limits is not None:
                owner[self._cells[name]] = len(sections)
                sections.append((region, f"material.regions.{name}"))
        for number, (section, place) in enumerate(sections):
            cells = np.flatnonzero(owner == number).astype(np.int32)
            for index, limit in enumerate(section.limits or ()):
                key = f"{place}.locking.{index}"
                short = f"{place}.locking_limit"
                yield limit, cells, key, f"{key}.at_most" if section.locking else short


def _upper(pieces: Sequence[Piece]) -> Bounds:
    return Bounds(pieces, "the limit")


def _lower(pieces: Sequence[Piece]) -> Bounds:
    return Bounds(pieces, "minus the lower limit", -1.0)


@dataclass(frozen=True)
class _Part:
    """Elasticity in some cells: E and nu if ``are_moduli``, lambda and mu, or a Mandel matrix."""

    cells: IndexArray
    key: str
    pieces: Sequence[Piece]
    are_moduli: bool

    @property
    def is_matrix(self) -> bool:
        return len(self.pieces) > 2

    def lame(self, points: Points) -> FloatArray:
        """Both Lame coefficients (2, k) at the points in the cells; collective."""
        first, second = (piece.at(points) for piece in self.pieces)
        return np.array(law.lame_from_young(first, second) if self.are_moduli else (first, second))

    def stiffness(self, points: Points) -> FloatArray:
        """Mandel matrices (k, s, s) at the points in the cells; collective."""
        domain = points.domain
        if not self.is_matrix:
            first, second = self.lame(points)
            pairs = domain.kinematics.mandel_pairs(domain.dim)
            return law.isotropic_stiffness(first, second, domain.dim, pairs)
        size = math.isqrt(len(self.pieces))
        entries = np.array([piece.at(points) for piece in self.pieces])
        found = entries.T.reshape(-1, size, size)
        require_symmetric(domain, found, f"{self.key}.stiffness")
        return found


@dataclass(frozen=True)
class _InParts:
    """Values (k, ...) that each part gives in its cells, of which the last counts."""

    parts: Sequence[_Part]
    of: Callable[[_Part, Points], FloatArray]
    shape: tuple[int, ...] = ()

    def at(self, points: Points) -> FloatArray:
        found = np.empty((len(points.all), *self.shape))
        for part in self.parts:
            found[points.of(part.cells)] = self.of(part, points)
        return found
