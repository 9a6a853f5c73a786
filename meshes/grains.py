"""Discs in a box, packed by gravity: each new disc comes to rest at the lowest free place."""

import itertools
import math
import random
from dataclasses import dataclass
from functools import cache
from typing import Any

from .geometry import Geometry, Point, Zone, parameter

_Disc = tuple[float, float, float]
# Rounding in places that touch, in radii.
_ROOM = 1e-9


@dataclass(frozen=True, kw_only=True)
class Grains(Geometry):
    """``count`` discs in 0 < x < width, y > 0, which touch each other and the box, or nearly so.

    Their radii are between (1 - spread) and (1 + spread) times ``radius``, by chance with the seed.
    Facets: grains, the circles of all discs.  ``h_contact`` is the element size everywhere.
    """

    count: int = parameter(20, "1", "number of discs")
    radius: float = parameter(1.0, "length", "mean radius of the discs")
    spread: float = parameter(0.2, "1", "how far radii are off the mean, as a share of it")
    width: float = parameter(8.0, "length", "width of the box")
    distance: float | None = parameter(None, "length", "gap left between the discs; null: none")
    seed: int = parameter(1, "1", "another number makes another packing")

    dim = 2
    contact_names = ("grains",)
    facet_names = ("grains",)
    cell_names = ("grains",)

    def validate(self) -> None:
        if not 1 <= self.count <= 1000:
            raise ValueError(f"count: must be 1 to 1000, not {self.count}")
        if self.spread >= 1.0:
            raise ValueError(f"spread: must be less than 1, not {self.spread:g}")
        if self.width < 2.0 * self.radius * (1.0 + self.spread):
            raise ValueError(f"width: {self.width:g} is less than the largest disc")

    @property
    def bodies(self) -> int:
        return self.count

    @property
    def thickness(self) -> float:
        return self.radius * (1.0 - self.spread)

    @property
    def measure(self) -> float:
        return math.pi * sum(radius**2 for _, _, radius in self.discs)

    @property
    def zone(self) -> Zone:
        """All of the box."""
        far = 4.0 * self.count * self.radius + self.width
        box = {"XMin": -far, "XMax": far, "YMin": -far, "YMax": far}
        return Zone("Box", box, self.measure)

    @property
    def discs(self) -> list[_Disc]:
        """The centres and radii (x, y, r)."""
        # Rounding decides between two places of one height: it must not depend on the unit.
        width, gap = (float(f"{x / self.radius:.9g}") for x in (self.width, self.distance or 0.0))
        packed = _packing(self.count, self.spread, width, gap, self.seed)
        return [(self.radius * x, self.radius * y, self.radius * r) for x, y, r in packed]

    def shape(self, occ: Any) -> dict[str, list[int]]:
        """The discs."""
        return {"grains": [occ.addDisk(x, y, 0.0, radius, radius) for x, y, radius in self.discs]}

    def facet_name(self, centre: Point, region: str) -> str:
        return "grains"


@cache
def _packing(count: int, spread: float, width: float, gap: float, seed: int) -> tuple[_Disc, ...]:
    """Discs of mean radius 1, each at the lowest free place."""
    chance = random.Random(seed)
    placed: list[_Disc] = []
    for _ in range(count):
        # With the gap around it a disc touches what it rests on.
        radius = 1.0 + spread * chance.uniform(-1.0, 1.0) + 0.5 * gap
        x, y = min(_places(placed, radius, width), key=lambda place: place[::-1])
        placed.append((x, y, radius))
    return tuple((x, y, radius - 0.5 * gap) for x, y, radius in placed)


def _places(placed: list[_Disc], radius: float, width: float) -> list[tuple[float, float]]:
    """Where a disc that touches two others, a wall or the floor has room."""
    low, high = radius, width - radius
    places = [(low, radius), (high, radius)]
    for x, y, other in placed:
        reach = radius + other
        for wall in (low, high):
            if (rest := reach**2 - (wall - x) ** 2) >= 0.0:
                places.append((wall, y + math.sqrt(rest)))
        if (rest := reach**2 - (radius - y) ** 2) >= 0.0:
            places += [(x - math.sqrt(rest), radius), (x + math.sqrt(rest), radius)]
    for pair in itertools.combinations(placed, 2):
        places += _beside(*pair, radius)
    return [
        (x, y)
        for x, y in places
        if low - _ROOM <= x <= high + _ROOM
        and y >= radius - _ROOM
        and all(math.hypot(x - a, y - b) >= radius + c - _ROOM for a, b, c in placed)
    ]


def _beside(first: _Disc, second: _Disc, radius: float) -> list[tuple[float, float]]:
    """The two centres of discs that touch two discs; none if these are too far apart."""
    a, b = first[2] + radius, second[2] + radius
    x, y = second[0] - first[0], second[1] - first[1]
    between = math.hypot(x, y)
    along = 0.5 * (between**2 + a**2 - b**2) / between
    if abs(along) > a:
        return []
    aside = math.sqrt(a**2 - along**2)
    x, y = x / between, y / between
    return [
        (first[0] + along * x - side * y, first[1] + along * y + side * x)
        for side in (aside, -aside)
    ]
