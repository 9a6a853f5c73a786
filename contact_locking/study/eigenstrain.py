"""The strains of a study file that are not elastic, at the time of its clock."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.fields.clock import Clock
from contact_locking.fields.sampling import Entities, features
from contact_locking.fields.values import PresentValue
from contact_locking.mesh.domain import Domain
from contact_locking.problem.points import Points
from contact_locking.study_file.parameters import Eigenstrain, MaterialParameters

_ADVICE = "refine the mesh there, or let a boundary of the region in its on go there"


@dataclass(frozen=True)
class _Part:
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
        self._parts: list[_Part] = []
        for place, item in given.eigenstrains:
            key = ".".join(map(str, ("material", *place)))
            cells: IndexArray = everywhere
            if item.on is not None:
                found = [domain.cells(name, f"{key}.on") for name in item.on]
                cells = np.asarray(np.unique(np.concatenate(found)), dtype=np.int32)
                self.regions.append(cells)
            self._parts.append(self._part(cells, item, key))

    def _part(self, cells: IndexArray, item: Eigenstrain, key: str) -> _Part:
        name, tensor = item.tensor

        def value(given: float | str, place: str) -> PresentValue:
            return PresentValue(self._domain.comm, given, f"{key}.{place}", self._clock)

        warm = None if item.temperature is None else value(item.temperature, "temperature")
        if not isinstance(tensor, tuple):
            alike = value(tensor, name)
            return _Part(cells, {(i, i): alike for i in range(3)}, warm)
        entries = {place: value(one, told) for place, one, told in _entries(tensor, name)}
        return _Part(cells, entries, warm)

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
                    told += features(inside, value.expression, value.key, _ADVICE, times=times)
        return told


def _entries(tensor: tuple[Any, ...], name: str) -> Iterator[tuple[tuple[int, int], Any, str]]:
    """Place, value and key of the entries of normal strains or of rows."""
    for i, row in enumerate(tensor):
        if isinstance(row, tuple):
            for j, one in enumerate(row):
                yield (i, j), one, f"{name}.{i}.{j}"
        else:
            yield (i, i), row, f"{name}.{i}"
