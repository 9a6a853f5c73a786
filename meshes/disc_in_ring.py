"""A disc, or a ring, in a ring, whose meshes do not match."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .annulus import sector
from .curved import Curved
from .geometry import GROWTH, Geometry, Zone, parameter


@dataclass(frozen=True, kw_only=True)
class DiscInRing(Geometry):
    """hole < |x| < radius and inner_radius < |x| < outer_radius; quartered by x > 0 and y > 0.

    Cells: disc, ring.  Facets: rim (of the disc), inner and outer (of the ring), hole if there is
    one; of the quarter also bottom (y = 0) and left (x = 0) of both.  A radius above the inner
    radius of the ring is an overlap.  The contact zone is the ring between rim and inner.
    """

    radius: float = parameter(1.0, "length", "radius of the disc")
    hole: float | None = parameter(None, "length", "radius of a hole in the disc; null: none")
    inner_radius: float = parameter(1.0, "length", "inner radius of the ring")
    outer_radius: float = parameter(2.0, "length", "outer radius of the ring")
    h_ring: float | None = parameter(
        None, "length", "target element size of the ring, at most h; null: 0.7 h"
    )
    quarter: bool = parameter(False, "1", "only x > 0 and y > 0")

    dim = 2
    bodies = 2
    cell_names = ("disc", "ring")
    contact_names = ("rim", "inner")

    def validate(self) -> None:
        """Check the order of the circles, and that the overlap is small."""
        if self.outer_radius <= max(self.inner_radius, self.radius):
            raise ValueError(
                f"outer_radius: {self.outer_radius:g} is not more than the radii inside, "
                f"{self.inner_radius:g} and {self.radius:g}"
            )
        if self.core >= min(self.inner_radius, self.radius):
            raise ValueError(f"hole: {self.core:g} is not less than the radius, {self.radius:g}")
        if self.fine > self.h:
            raise ValueError(f"h_ring: {self.fine:g} is more than h, {self.h:g}")

    @property
    def core(self) -> float:
        """The radius of the hole, 0 without one."""
        return 0.0 if self.hole is None else self.hole

    @property
    def fine(self) -> float:
        """The element size of the ring."""
        return 0.7 * self.h if self.h_ring is None else self.h_ring

    @property
    def thickness(self) -> float:
        """The thinner of both bodies."""
        return min(self.outer_radius - self.inner_radius, self.radius - self.core)

    @property
    def angle(self) -> float:
        """The angle of the sector."""
        return math.pi / 2 if self.quarter else 2 * math.pi

    @property
    def measure(self) -> float:
        """The area of both bodies."""
        squares = self.outer_radius**2 - self.inner_radius**2 + self.radius**2 - self.core**2
        return self.angle / 2 * squares

    @property
    def facet_names(self) -> tuple[str, ...]:
        """The circles and, for a quarter, the straight sides."""
        hole = [] if self.hole is None else ["hole"]
        return (*hole, "rim", "inner", "outer", *["bottom", "left"][: 2 * self.quarter])

    @property
    def zone(self) -> Zone:
        """Two layers of elements on both sides of the interface."""
        reach = max(self.radius, self.inner_radius) + 2 * self.finest
        depth = 4 * self.finest + self.finest / GROWTH
        return Zone("Ball", {"Radius": reach}, self.angle * reach * depth)

    @property
    def curved(self) -> tuple[Curved, ...]:
        """The circles."""
        radii = {"rim": self.radius, "inner": self.inner_radius, "outer": self.outer_radius}
        radii |= {} if self.hole is None else {"hole": self.hole}
        return tuple(Curved((name,), (0.0, 0.0), radius) for name, radius in radii.items())

    def shape(self, occ: Any) -> dict[str, list[int]]:
        """Both bodies between arcs of a quarter circle, each with corners of its own."""
        origin = occ.addPoint(0, 0, 0)
        return {
            "disc": [sector(occ, origin, (self.core, self.radius), self.quarter)],
            "ring": [sector(occ, origin, (self.inner_radius, self.outer_radius), self.quarter)],
        }

    def name_of(self, model: Any, tag: int, regions: dict[str, list[int]]) -> str:
        """The name of a side, which tells the bodies apart by the cells beside it."""
        (beside,) = model.getAdjacencies(1, tag)[0]
        x, y, _ = model.occ.getCenterOfMass(1, tag)
        if self.at(y, 0):
            return "bottom"
        if self.at(x, 0):
            return "left"
        # The centre of a quarter circle is at sin(pi/4)/(pi/4) of the radius along the bisector.
        radius = math.hypot(x, y) * math.pi / 4 / math.sin(math.pi / 4)
        if beside in regions["disc"]:
            return "rim" if radius > (self.core + self.radius) / 2 else "hole"
        return "inner" if radius < (self.inner_radius + self.outer_radius) / 2 else "outer"

    def set_sizes(self, model: Any, sides: Sequence[int] = ()) -> None:
        """Prescribe the element size of both bodies, and of the zone."""
        super().set_sizes(model, sides)
        self.refine_second(model, self.fine)
