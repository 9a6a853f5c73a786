"""The lower half of a ball, or a quarter of that, which touches z = 0 from above."""

import math
from dataclasses import dataclass
from typing import Any

from .curved import Curved
from .disc import Round
from .geometry import Point, Zone, parameter


@dataclass(frozen=True, kw_only=True)
class Ball(Round):
    """|x - (0, 0, radius)| < radius, z < radius; quartered by x > 0 and y > 0.

    Facets: contact, side, top (z = radius), of the quarter also symmetry_x (x = 0) and symmetry_y
    (y = 0). The contact zone is within ``contact_width`` of the origin.
    """

    h: float = parameter(0.2, "length", "target element size")

    dim = 3

    @property
    def measure(self) -> float:
        return 2 / 3 * math.pi * self.radius**3 / (4 if self.quarter else 1)

    @property
    def zone(self) -> Zone:
        """The part of the body within ``contact_width`` of the origin."""
        volume = 2 / 3 * math.pi * self.reach**3 / (4 if self.quarter else 1)
        return Zone("Ball", {"Radius": self.reach}, volume)

    @property
    def facet_names(self) -> tuple[str, ...]:
        return ("contact", "side", "top", *["symmetry_x", "symmetry_y"][: 2 * self.quarter])

    @property
    def curved(self) -> tuple[Curved, ...]:
        rim = Curved(("contact", "side"), (0.0, 0.0, self.rise), self.reach, level=True)
        return (*super().curved, rim)

    def shape(self, occ: Any) -> dict[str, list[int]]:
        """The part of a ball with its poles on the edge of the top, cut by the contact circle."""
        # The parametrisation of a sphere is singular at its poles: keep them off the contact.
        lowest, longitude = (0.0, math.pi / 2) if self.quarter else (-math.pi / 2, math.pi)
        ball = (3, occ.addSphere(0, 0, 0, self.radius, -1, lowest, math.pi / 2, longitude))
        occ.rotate([ball], 0, 0, 0, 1, 0, 0, -math.pi / 2)
        occ.translate([ball], 0, 0, self.radius)
        turn = math.pi / 2 if self.quarter else 2 * math.pi
        cuts = [(1, occ.addCircle(0, 0, self.rise, self.reach, angle1=0, angle2=turn))]
        if not self.quarter:
            # Two arcs across the contact make the origin a node, as in the quarter.
            centre, origin = occ.addPoint(0, 0, self.radius), occ.addPoint(0, 0, 0)
            ends = [occ.addPoint(x, 0, self.rise) for x in (-self.reach, self.reach)]
            cuts += [(1, occ.addCircleArc(origin, centre, end)) for end in ends]
        _, (parts, *_) = occ.fragment([ball], cuts)
        return {"body": [tag for _, tag in parts]}

    def facet_name(self, centre: Point, region: str) -> str:
        """The name of the side with this centre of mass, which lies inside the ball."""
        x, y, z = centre
        if self.quarter and self.at(x, 0):
            return "symmetry_x"
        if self.quarter and self.at(y, 0):
            return "symmetry_y"
        if self.at(z, self.radius):
            return "top"
        return "contact" if z < self.rise else "side"
