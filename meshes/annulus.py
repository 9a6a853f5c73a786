"""The annulus between two circles, or a quarter of it."""

import math
from abc import abstractmethod
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from .curved import Curved
from .geometry import GROWTH, Geometry, Point, Zone, below, parameter


class Rings(Geometry):
    """The base of bodies between circles about the origin, or of their quarters x > 0 and y > 0.

    Facets: the circles; of a quarter also bottom (y = 0) and left (x = 0).
    """

    quarter: bool
    dim = 2

    @property
    @abstractmethod
    def circles(self) -> dict[str, dict[str, float]]:
        """For each region the radii of its circles from inside by the names of the facets."""

    @property
    def radii(self) -> dict[str, float]:
        """The radii of all circles by the names of the facets."""
        return {name: radius for ring in self.circles.values() for name, radius in ring.items()}

    @property
    def angle(self) -> float:
        """The angle of the sector."""
        return math.pi / 2 if self.quarter else 2 * math.pi

    @property
    def rings(self) -> dict[str, tuple[float, float]]:
        """The inner radius, which may be 0, and the outer radius of each region."""
        found = {}
        for region, ring in self.circles.items():
            *inner, outer = ring.values()
            found[region] = (inner[0] if inner else 0.0, outer)
        return found

    @property
    def thickness(self) -> float:
        return min(outer - inner for inner, outer in self.rings.values())

    @property
    def measure(self) -> float:
        return self.angle / 2 * sum(outer**2 - inner**2 for inner, outer in self.rings.values())

    @property
    def facet_names(self) -> tuple[str, ...]:
        return (*self.radii, *["bottom", "left"][: 2 * self.quarter])

    @property
    def curved(self) -> tuple[Curved, ...]:
        return tuple(Curved((name,), (0.0, 0.0), radius) for name, radius in self.radii.items())

    def shape(self, occ: Any) -> dict[str, list[int]]:
        """The regions between arcs of a quarter circle, each with corners of its own."""
        origin = occ.addPoint(0, 0, 0)
        return {
            region: [sector(occ, origin, radii, self.quarter)]
            for region, radii in self.rings.items()
        }

    def facet_name(self, centre: Point, region: str) -> str:
        x, y, _ = centre
        if self.at(y, 0):
            return "bottom"
        if self.at(x, 0):
            return "left"
        # The centre of a quarter circle is at sin(pi/4)/(pi/4) of the radius along the bisector.
        radius = math.hypot(x, y) * math.pi / 4 / math.sin(math.pi / 4)
        circles = self.circles[region]
        return min(circles, key=lambda name: abs(circles[name] - radius))


@dataclass(frozen=True, kw_only=True)
class Annulus(Rings):
    """inner_radius < |x| < outer_radius; quartered by x > 0 and y > 0.

    Facets: inner, outer; of the quarter also bottom (y = 0) and left (x = 0). The contact zone is
    the inner circle.
    """

    inner_radius: float = parameter(1.0, "length", "radius of the hole")
    outer_radius: float = parameter(2.0, "length", "radius of the annulus")
    quarter: bool = parameter(False, "1", "only x > 0 and y > 0")

    contact_names = ("inner",)

    def validate(self) -> None:
        below("inner_radius", self.inner_radius, self.outer_radius, "the outer radius")

    @property
    def circles(self) -> dict[str, dict[str, float]]:
        return {"body": {"inner": self.inner_radius, "outer": self.outer_radius}}

    @property
    def zone(self) -> Zone:
        """Two layers of elements around the hole."""
        reach = self.inner_radius + 2 * self.finest
        depth = 2 * self.finest + self.finest / GROWTH
        return Zone("Ball", {"Radius": reach}, self.angle * reach * depth)


def sector(occ: Any, origin: int, radii: tuple[float, float], quarter: bool) -> int:
    """The tag of a new surface between two circles about ``origin``; the first radius may be 0.

    It is bounded by arcs of a quarter circle.  With ``quarter`` it is the part in x > 0 and y > 0.
    """
    axes = [(1, 0), (0, 1), (-1, 0), (0, -1)][: 2 if quarter else 4]
    rings = [
        [occ.addPoint(radius * x, radius * y, 0) for x, y in axes]
        if radius
        else [origin] * len(axes)
        for radius in radii
    ]
    inner, outer = (
        [
            occ.addCircleArc(start, origin, end)
            for start, end in pairwise(points if quarter else [*points, points[0]])
            if start != end
        ]
        for points in rings
    )
    if quarter:
        bottom, left = (occ.addLine(*ends) for ends in zip(*rings, strict=True))
        loops = [occ.addCurveLoop([bottom, *outer, left, *inner])]
    else:
        loops = [occ.addCurveLoop(part) for part in (outer, inner) if part]
    return int(occ.addPlaneSurface(loops))
