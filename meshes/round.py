"""Round bodies: the disc, half of it and of the ball, the annulus, the disc in a ring or a grip."""

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from .geometry import GROWTH, Curved, Geometry, Point, Zone, at_most, below, parameter


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
        rings = {}
        for region, ring in self.circles.items():
            *inner, outer = ring.values()
            rings[region] = (inner[0] if inner else 0.0, outer)
        return rings

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
