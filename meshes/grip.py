"""A disc between two fingers that hang down, whose meshes do not match."""

import math
from dataclasses import dataclass
from typing import Any

from .curved import Curved
from .geometry import Geometry, Point, Zone, below, parameter


@dataclass(frozen=True, kw_only=True)
class Grip(Geometry):
    """|x| < radius between the fingers radius < |x_1| < radius + width, -radius < x_2 < length.

    Cells: ball, left, right.  Facets: rim (of the disc); of each finger left_pad and right_pad,
    which touch the disc, left_root and right_root at the top, left_back and right_back for the
    rest.  The contact zone is the disc and what is as near to its middle.
    """

    radius: float = parameter(1.0, "length", "radius of the disc")
    width: float = parameter(0.5, "length", "width of the fingers")
    length: float = parameter(2.5, "length", "height of the fingers above the middle of the disc")

    dim = 2
    bodies = 3
    cell_names = ("ball", "left", "right")
    contact_names = ("rim", "left_pad", "right_pad")

    def validate(self) -> None:
        below("radius", self.radius, self.length, "the length of the fingers")

    @property
    def thickness(self) -> float:
        return min(self.width, self.radius)

    @property
    def measure(self) -> float:
        return math.pi * self.radius**2 + 2 * self.width * (self.length + self.radius)

    @property
    def facet_names(self) -> tuple[str, ...]:
        parts = ("pad", "root", "back")
        return ("rim", *(f"{side}_{part}" for side in ("left", "right") for part in parts))

    @property
    def zone(self) -> Zone:
        """The disc, and as much of the fingers."""
        reach = 1.2 * self.radius
        return Zone("Ball", {"Radius": reach}, math.pi * reach**2)

    @property
    def curved(self) -> tuple[Curved, ...]:
        return (Curved(("rim",), (0.0, 0.0), self.radius),)

    def shape(self, occ: Any) -> dict[str, list[int]]:
        """The disc and the fingers; the disc has nodes where it touches them."""
        r, high = self.radius, self.length + self.radius
        middle = occ.addPoint(0, 0, 0)
        ends = [occ.addPoint(x, 0, 0) for x in (-r, r)]
        arcs = [occ.addCircleArc(a, middle, b) for a, b in (ends, ends[::-1])]
        return {
            "ball": [occ.addPlaneSurface([occ.addCurveLoop(arcs)])],
            "left": [occ.addRectangle(-r - self.width, -r, 0, self.width, high)],
            "right": [occ.addRectangle(r, -r, 0, self.width, high)],
        }

    def facet_name(self, centre: Point, region: str) -> str:
        if region == "ball":
            return "rim"
        x, y, _ = centre
        if self.at(abs(x), self.radius):
            return f"{region}_pad"
        return f"{region}_root" if self.at(y, self.length) else f"{region}_back"
