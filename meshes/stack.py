"""Two blocks, one on the other, whose meshes do not match."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .block import Block
from .geometry import Point, Zone, at_most, length, parameter, real


@dataclass(frozen=True, kw_only=True)
class Stack(Block):
    """A block [0, a] x ([0, b] x) [0, c] and another one above its middle, with nodes of their own.

    The interface rises by ``slope`` from left to right, about the middle of the lower block.
    Cells: lower, upper.  Facets of the lower block: left, right, in 3D front, back, bottom, and
    lower_top; of the upper block: upper_left, upper_right, in 3D upper_front, upper_back,
    upper_bottom, and top.  The contact zone is the interface.  Structured: two grids.
    """

    upper: tuple[float, ...] = parameter(
        (), "length", "edges of the upper block along x, (y,) and up; empty: as those of size"
    )
    h_upper: float | None = parameter(
        None, "length", "target element size of the upper block, at most h; null: 0.7 h"
    )
    distance: float | None = parameter(
        None, "length", "the gap between the blocks along the last axis; null: none"
    )
    slope: float = parameter(0, "1", "rise of the interface over its length along x")

    bodies = 2
    cell_names = ("lower", "upper")
    contact_names = ("lower_top", "upper_bottom")

    def validate(self) -> None:
        super().validate()
        self.complete("upper", self.size, length)
        object.__setattr__(self, "slope", real("slope", self.slope))
        if self.structured and self.dim == 3 and self.cells == "simplex":
            # Gmsh splits the sides of these prisms in another way than their boxes.
            raise ValueError("structured: a stack in 3D is a grid of boxes alone; add cells: box")
        at_most("h_upper", self.fine, self.h, "h")
        if abs(self.slope) * max(self.size[0], self.upper[0]) > min(self.size[-1], self.upper[-1]):
            raise ValueError(f"slope: {self.slope:g} takes more than half of the height of a block")

    @property
    def fine(self) -> float:
        """The element size of the upper block."""
        return 0.7 * self.h if self.h_upper is None else self.h_upper

    @property
    def blocks(self) -> tuple[tuple[tuple[float, ...], float], ...]:
        """The lower and the upper block."""
        return ((self.size, self.h), (self.upper, self.fine))

    @property
    def thickness(self) -> float:
        return min(*self.size, *self.upper)

    @property
    def measure(self) -> float:
        return math.prod(self.size) + math.prod(self.upper)

    @property
    def facet_names(self) -> tuple[str, ...]:
        *around, bottom, top = self.sides
        of_upper = (f"upper_{name}" for name in (*around, "bottom"))
        return (*around, bottom, "lower_top", *of_upper, top)

    @property
    def zone(self) -> Zone:
        """Two layers of elements on both sides of the interface."""
        rise = 0.5 * abs(self.slope) * max(self.size[0], self.upper[0])
        depth = 2 * self.finest + rise
        middle = self.size[-1] + 0.5 * self.between
        far = depth + 0.5 * self.between
        box = self.limits(upper=middle + far, lower=middle - far)
        area = math.prod(self.size[:-1]) + math.prod(self.upper[:-1])
        return Zone("Box", box, area * (depth + self.transition))

    @property
    def between(self) -> float:
        """The gap between the blocks."""
        return self.distance or 0.0

    def shape(self, occ: Any) -> dict[str, list[int]]:
        """Both blocks, each with corners of its own."""
        a, c = self.size[0], self.size[-1]
        width, height = self.upper[0], self.upper[-1]
        left = 0.5 * (a - width)

        def at(x: float) -> float:
            return c + self.slope * (x - 0.5 * a)

        lower = [(0.0, 0.0), (a, 0.0), (a, at(a)), (0.0, at(0.0))]
        right, gap = left + width, self.between
        top = c + gap + height
        upper = [(left, at(left) + gap), (right, at(right) + gap), (right, top), (left, top)]
        depth = self.size[1] if self.dim == 3 else 0.0
        deep = self.upper[1] if self.dim == 3 else 0.0
        return {
            "lower": [self._prism(occ, lower, 0.0, depth)],
            "upper": [self._prism(occ, upper, 0.5 * (depth - deep), deep)],
        }

    def _prism(
        self, occ: Any, corners: Sequence[tuple[float, float]], start: float, depth: float
    ) -> int:
        """The face with these corners (x, up), or in 3D a prism on it along y."""
        if self.dim == 2:
            points = [occ.addPoint(x, up, 0.0) for x, up in corners]
        else:
            points = [occ.addPoint(x, start, up) for x, up in corners]
        ends = zip(points, [*points[1:], points[0]], strict=True)
        face = occ.addPlaneSurface([occ.addCurveLoop([occ.addLine(*pair) for pair in ends])])
        if self.dim == 2:
            return int(face)
        made = occ.extrude([(2, face)], 0.0, depth, 0.0)
        return next(int(tag) for dim, tag in made if dim == 3)

    def facet_name(self, centre: Point, region: str) -> str:
        x, *middle, up = centre[: self.dim]
        is_upper = region == "upper"
        edges, start = (self.upper, self.size[-1] + self.between) if is_upper else (self.size, 0.0)
        # Sides that are no ends of the interface, whose middle lies at its height.
        centred = [x - 0.5 * (self.size[0] - edges[0])]
        centred += [y - 0.5 * (self.size[1] - edges[1]) for y in middle]
        names = iter(self.sides)
        for coordinate, edge in zip(centred, edges, strict=False):
            for plane in (0.0, edge):
                name = next(names)
                if self.at(coordinate, plane):
                    return f"upper_{name}" if is_upper else name
        low = self.at(up, start)
        if is_upper:
            return "upper_bottom" if low else "top"
        return "bottom" if low else "lower_top"

    def set_sizes(self, model: Any, sides: Sequence[int] = ()) -> None:
        super().set_sizes(model, sides)
        if not self.structured:
            self.refine_second(model, self.fine)
