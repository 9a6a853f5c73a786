"""The annulus between two circles, or a quarter of it."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from .curved import Curved
from .geometry import GROWTH, Geometry, Point, Zone, parameter


@dataclass(frozen=True, kw_only=True)
class Annulus(Geometry):
    """inner_radius < |x| < outer_radius; quartered by x > 0 and y > 0.

    Facets: inner, outer; of the quarter also bottom (y = 0) and left (x = 0). The contact zone is
    the inner circle.
    """

    inner_radius: float = parameter(1.0, "length", "radius of the hole")
    outer_radius: float = parameter(2.0, "length", "radius of the annulus")
    quarter: bool = parameter(False, "1", "only x > 0 and y > 0")

    dim = 2
    contact_names = ("inner",)

    def validate(self) -> None:
        """Check that the outer circle is larger."""
        if self.outer_radius <= self.inner_radius:
            raise ValueError(
                f"outer_radius: {self.outer_radius:g} is not more than the inner radius, "
                f"{self.inner_radius:g}"
            )

    @property
    def thickness(self) -> float:
        """The distance between the circles."""
        return self.outer_radius - self.inner_radius

    @property
    def angle(self) -> float:
        """The angle of the sector."""
        return math.pi / 2 if self.quarter else 2 * math.pi

    @property
    def measure(self) -> float:
        """The area of the sector."""
        return self.angle / 2 * (self.outer_radius**2 - self.inner_radius**2)

    @property
    def zone(self) -> Zone:
        """Two layers of elements around the hole."""
        reach = self.inner_radius + 2 * self.finest
        depth = 2 * self.finest + self.finest / GROWTH
        return Zone("Ball", {"Radius": reach}, self.angle * reach * depth)

    @property
    def facet_names(self) -> tuple[str, ...]:
        """The circles and, for a quarter, the straight sides."""
        return ("inner", "outer", "bottom", "left") if self.quarter else ("inner", "outer")

    @property
    def curved(self) -> tuple[Curved, ...]:
        """The circles."""
        radii = {"inner": self.inner_radius, "outer": self.outer_radius}
        return tuple(Curved((name,), (0.0, 0.0), radius) for name, radius in radii.items())

    def shape(self, occ: Any) -> dict[str, list[int]]:
        """The sector between arcs of a quarter circle, whose centres of mass tell the radii."""
        radii = (self.inner_radius, self.outer_radius)
        return {"body": [sector(occ, occ.addPoint(0, 0, 0), radii, self.quarter)]}

    def facet_name(self, centre: Point) -> str:
        """The name of the side with this centre of mass.

        The centre of a quarter circle is at sin(pi/4)/(pi/4) of the radius along the bisector.
        """
        x, y, _ = centre
        if self.at(y, 0):
            return "bottom"
        if self.at(x, 0):
            return "left"
        middle = (self.inner_radius + self.outer_radius) / 2
        return (
            "inner" if math.hypot(x, y) < middle * math.sin(math.pi / 4) * 4 / math.pi else "outer"
        )


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
