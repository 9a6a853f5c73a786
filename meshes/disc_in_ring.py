"""A disc, or a ring, in a ring, whose meshes do not match."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .annulus import Rings
from .geometry import GROWTH, Zone, at_most, below, parameter


@dataclass(frozen=True, kw_only=True)
class DiscInRing(Rings):
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

    bodies = 2
    cell_names = ("disc", "ring")
    contact_names = ("rim", "inner")

    def validate(self) -> None:
        for name in ("inner_radius", "radius"):
            below(name, getattr(self, name), self.outer_radius, "the outer radius")
            below("hole", self.hole or 0.0, getattr(self, name), name)
        at_most("h_ring", self.fine, self.h, "h")

    @property
    def fine(self) -> float:
        """The element size of the ring."""
        return 0.7 * self.h if self.h_ring is None else self.h_ring

    @property
    def circles(self) -> dict[str, dict[str, float]]:
        hole = {} if self.hole is None else {"hole": self.hole}
        ring = {"inner": self.inner_radius, "outer": self.outer_radius}
        return {"disc": {**hole, "rim": self.radius}, "ring": ring}

    @property
    def zone(self) -> Zone:
        """Two layers of elements on both sides of the interface."""
        reach = max(self.radius, self.inner_radius) + 2 * self.finest
        depth = 4 * self.finest + self.finest / GROWTH
        return Zone("Ball", {"Radius": reach}, self.angle * reach * depth)

    def set_sizes(self, model: Any, sides: Sequence[int] = ()) -> None:
        super().set_sizes(model, sides)
        self.refine_second(model, self.fine)
