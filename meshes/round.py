"""Round bodies that touch the ground from above: the disc or half of it, and half of the ball."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from .curved import Curved
from .geometry import Geometry, Point, Zone, at_most, below, parameter


@dataclass(frozen=True, kw_only=True)
class Round(Geometry):
    """A round body that touches the ground at the origin: the base of disc and ball.

    The centre is ``radius`` above the origin. The boundary part contact is the part of the circle
    or sphere at the bottom within ``contact_width`` of the vertical axis; side is the rest.
    """

    radius: float = parameter(1.0, "length", "radius of the body")
    contact_width: float | None = parameter(
        None, "length", "half-width of the part of the boundary named contact; null: radius / 4"
    )
    quarter: bool = parameter(False, "1", "only the part between the planes of symmetry")

    contact_names = ("contact",)

    def validate(self) -> None:
        below("contact_width", self.reach, self.radius, "the radius")
        if self.reach < 1e-3 * self.radius:
            # The height of the contact part would be below the tolerances of the geometry kernel.
            raise ValueError(
                f"contact_width: {self.reach:g} is less than a thousandth of the radius, "
                f"{self.radius:g}"
            )
        at_most("h_contact", self.finest, self.reach, "contact_width")

    @property
    def thickness(self) -> float:
        return self.radius

    @property
    def reach(self) -> float:
        """The contact width, by default a quarter of the radius."""
        return self.radius / 4 if self.contact_width is None else self.contact_width

    @property
    def rise(self) -> float:
        """The height at which the contact part ends."""
        return self.radius - math.sqrt(self.radius**2 - self.reach**2)

    @property
    def curved(self) -> tuple[Curved, ...]:
        centre = (*(0.0,) * (self.dim - 1), self.radius)
        return tuple(Curved((name,), centre, self.radius) for name in ("contact", "side"))


@dataclass(frozen=True, kw_only=True)
class Disc(Round):
    """|x - (0, radius)| < radius; halved by y < radius, quartered by x > 0 as well.

    Facets: contact, side, top (y = radius, where it is halved), symmetry (x = 0, where it is
    quartered). The contact zone is within ``contact_width`` of the origin.
    """

    half: bool = parameter(True, "1", "only the lower half, with a flat top")

    dim = 2

    def validate(self) -> None:
        super().validate()
        if self.quarter and not self.half:
            raise ValueError("quarter: only the half disc can be quartered; set half: true")

    @property
    def measure(self) -> float:
        return math.pi * self.radius**2 / (4 if self.quarter else 2 if self.half else 1)

    @property
    def zone(self) -> Zone:
        """The part of the body within ``contact_width`` of the origin."""
        area = math.pi * self.reach**2 / (4 if self.quarter else 2)
        return Zone("Ball", {"Radius": self.reach}, area)

    @property
    def facet_names(self) -> tuple[str, ...]:
        return ("contact", "side", *["top"] * self.half, *["symmetry"] * self.quarter)

    def shape(self, occ: Any) -> dict[str, list[int]]:
        """The body between arcs of less than half a circle, with a vertex at the origin."""
        r, w = self.radius, self.reach
        end = (r, r) if self.half else (0.0, 2 * r)
        right = [(0.0, 0.0), (w, self.rise), end]
        left = [] if self.quarter else [(-x, y) for x, y in reversed(right[1:])]
        points = [occ.addPoint(x, y, 0) for x, y in left + right]
        if not self.half:
            # The arcs on both sides end at the same highest point.
            points[-1] = points[0]
        centre = occ.addPoint(0, r, 0)
        curves = [occ.addCircleArc(a, centre, b) for a, b in pairwise(points)]
        if self.quarter:
            curves += [occ.addLine(points[-1], centre), occ.addLine(centre, points[0])]
        elif self.half:
            curves.append(occ.addLine(points[-1], points[0]))
        body = occ.addPlaneSurface([occ.addCurveLoop(curves)])
        return {"body": [body]}

    def facet_name(self, centre: Point, region: str) -> str:
        """The name of the side with this centre of mass, for an arc between its ends in height."""
        x, y, _ = centre
        if self.quarter and self.at(x, 0):
            return "symmetry"
        if self.half and self.at(y, self.radius):
            return "top"
        return "contact" if y < self.rise else "side"


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
