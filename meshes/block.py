"""The block, a rectangle or a box, bodies that are cut from it, and two blocks on each other."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from .geometry import (
    GROWTH,
    Curved,
    Geometry,
    Point,
    Zone,
    at_most,
    below,
    dimension,
    length,
    parameter,
    real,
    vector,
)


@dataclass(frozen=True, kw_only=True)
class Box(Geometry):
    """[0, a] x [0, c] or [0, a] x [0, b] x [0, c]: the base of all geometries cut from a block.

    The last axis points up. Facets: left, right (x), in 3D front, back (y), bottom, top.
    The contact zone is the bottom.
    """

    dim: int = parameter(2, "1", "dimension of the body, 2 or 3")
    size: tuple[float, ...] = parameter((), "length", "edges along x, (y,) and up; empty: all 1")

    contact_names: ClassVar[tuple[str, ...]] = ("bottom",)

    def validate(self) -> None:
        object.__setattr__(self, "dim", dimension(self.dim))
        self.complete("size", (1.0,) * self.dim, length)

    def complete(
        self, name: str, default: tuple[float, ...], check: Callable[[str, Any], float]
    ) -> None:
        """Give a list of numbers that is empty its default, and check each number."""
        values = default if getattr(self, name) in (None, (), []) else getattr(self, name)
        numbers = tuple(check(name, x) for x in vector(name, values, len(default)))
        object.__setattr__(self, name, numbers)

    @property
    def thickness(self) -> float:
        return min(self.size)

    @property
    def measure(self) -> float:
        return math.prod(self.size)

    @property
    def facet_names(self) -> tuple[str, ...]:
        return self.sides

    @property
    def sides(self) -> tuple[str, ...]:
        """The names of the sides of the block, two for each axis."""
        return ("left", "right", *("front", "back")[: 2 * (self.dim - 2)], "bottom", "top")

    @property
    def zone(self) -> Zone:
        """Two layers of elements at the bottom."""
        depth = 2 * self.finest
        area = self.measure / self.size[-1]
        return Zone("Box", self.limits(upper=depth), area * (depth + self.transition))

    @property
    def transition(self) -> float:
        """The thickness of a layer of size ``h_contact`` with as many cells as the growth to h."""
        return self.finest / GROWTH / (self.dim - 1)

    def limits(self, upper: float | None = None, lower: float | None = None) -> dict[str, float]:
        """The limits of Gmsh's box field between two heights; None is no limit."""
        far = 2 * max(self.size)
        box = {f"{axis}Min": -far for axis in "XYZ"} | {f"{axis}Max": far for axis in "XYZ"}
        up = "YZ"[self.dim - 2]
        heights = {f"{up}Min": lower, f"{up}Max": upper}
        return box | {limit: value for limit, value in heights.items() if value is not None}

    def shape(self, occ: Any) -> dict[str, list[int]]:
        """The whole block."""
        return {"body": [self.cuboid(occ, (0.0,) * self.dim, self.size)]}

    def cuboid(self, occ: Any, corner: tuple[float, ...], edges: tuple[float, ...]) -> int:
        """The tag of a new rectangle or box with the given lowest corner and edges."""
        if self.dim == 2:
            return occ.addRectangle(*corner, 0, *edges)
        return occ.addBox(*corner, *edges)

    def facet_name(self, centre: Point, region: str) -> str:
        return self.side(centre)

    def side(self, centre: Point) -> str:
        """The name of the side of the block on which a point lies; "" inside the block."""
        names = iter(self.sides)
        for coordinate, edge in zip(centre, self.size, strict=False):
            for plane in (0.0, edge):
                name = next(names)
                if self.at(coordinate, plane):
                    return name
        return ""


@dataclass(frozen=True, kw_only=True)
class Block(Box):
    """A block, unstructured or as a regular grid of boxes or of split boxes."""

    structured: bool = parameter(False, "1", "regular grid, of boxes or of split boxes")

    def validate(self) -> None:
        super().validate()
        if self.structured and self.h_contact is not None:
            raise ValueError("h_contact: a structured block has one element size; leave it out")

    @property
    def blocks(self) -> tuple[tuple[tuple[float, ...], float], ...]:
        """The edges and the element size of each block, in the order of the regions."""
        return ((self.size, self.h),)

    @property
    def divisions(self) -> list[list[int]]:
        """The number of grid cells along each edge of each block, none longer than its size."""
        return [[math.ceil(edge / h - 1e-9) for edge in edges] for edges, h in self.blocks]

    def estimated_cells(self) -> float:
        """The exact number of cells of a structured block, else the estimate of the base class."""
        if not self.structured:
            return super().estimated_cells()
        split = math.factorial(self.dim) if self.cells == "simplex" else 1
        return split * sum(map(math.prod, self.divisions))

    @property
    def subdivides(self) -> bool:
        """A regular grid consists of boxes."""
        return super().subdivides and not self.structured

    def set_sizes(self, model: Any, sides: Sequence[int] = ()) -> None:
        """Prescribe the grid of a structured block, else the element size of the base class."""
        if not self.structured:
            super().set_sizes(model, sides)
            return
        entities = model.getEntities(self.dim)
        for entity, (size, _), divisions in zip(entities, self.blocks, self.divisions, strict=True):
            curves = model.getBoundary([entity], oriented=False)
            if self.dim == 3:
                curves = model.getBoundary(curves, combined=False, oriented=False)
            for _, tag in curves:
                box = model.getBoundingBox(1, tag)
                # A tilted side has the whole of the edge along x.
                shares = [(box[axis + 3] - box[axis]) / edge for axis, edge in enumerate(size)]
                axis = shares.index(max(shares))
                model.mesh.setTransfiniteCurve(tag, divisions[axis] + 1)
        for _, tag in model.getEntities(2):
            model.mesh.setTransfiniteSurface(tag)
        for _, tag in model.getEntities(3):
            model.mesh.setTransfiniteVolume(tag)


@dataclass(frozen=True, kw_only=True)
class Inclusion(Box):
    """A block with a disc or a ball of another material inside, with one conforming mesh.

    Cells: body and inclusion. Facets: the sides of the block. The contact zone is the bottom.
    """

    radius: float = parameter(0.25, "length", "radius of the inclusion")
    centre: tuple[float, ...] = parameter(
        (), "length", "centre of the inclusion; empty: the middle of the block"
    )

    cell_names = ("body", "inclusion")

    def validate(self) -> None:
        super().validate()
        self.complete("centre", tuple(edge / 2 for edge in self.size), real)
        at_most("h", self.h, self.radius, "the radius of the inclusion")
        gap = (
            min(min(x, edge - x) for x, edge in zip(self.centre, self.size, strict=True))
            - self.radius
        )
        if gap < 0.05 * self.radius:
            raise ValueError(
                f"radius: an inclusion of {self.radius:g} around {list(self.centre)} does not stay "
                f"inside the block {list(self.size)}"
            )

    @property
    def curved(self) -> tuple[Curved, ...]:
        return (Curved(("body", "inclusion"), self.centre, self.radius),)

    def shape(self, occ: Any) -> dict[str, list[int]]:
        """The block, divided into body and inclusion."""
        (block,) = super().shape(occ)["body"]
        if self.dim == 2:
            core = occ.addDisk(*self.centre, 0, self.radius, self.radius)
        else:
            core = occ.addSphere(*self.centre, self.radius)
        _, (parts, inner) = occ.fragment([(self.dim, block)], [(self.dim, core)])
        return {
            "body": [tag for dim, tag in parts if (dim, tag) not in inner],
            "inclusion": [tag for _, tag in inner],
        }


@dataclass(frozen=True, kw_only=True)
class LShape(Box):
    """A block without its upper right corner, the notch: a foot and an upright.

    Facets: the sides of the block, where right is the end of the foot and top the end of the
    upright; inner_horizontal, the upper side of the foot; inner_vertical, the right side of the
    upright.  The contact zone is the bottom.
    """

    notch: tuple[float, ...] = parameter(
        (), "length", "what is cut away along x and up; empty: half of the block"
    )

    def validate(self) -> None:
        super().validate()
        edges = (self.size[0], self.size[-1])
        self.complete("notch", (edges[0] / 2, edges[1] / 2), length)
        if any(cut >= edge for cut, edge in zip(self.notch, edges, strict=True)):
            raise ValueError(f"notch: {list(self.notch)} is not inside the block {list(self.size)}")

    @property
    def thickness(self) -> float:
        return min(self.size[0] - self.notch[0], self.size[-1] - self.notch[1], *self.size)

    @property
    def measure(self) -> float:
        share = math.prod(self.notch) / (self.size[0] * self.size[-1])
        return super().measure * (1 - share)

    @property
    def facet_names(self) -> tuple[str, ...]:
        return (*self.sides, "inner_horizontal", "inner_vertical")

    def shape(self, occ: Any) -> dict[str, list[int]]:
        """The block without the notch."""
        (block,) = super().shape(occ)["body"]
        depth = self.size[1:-1]
        corner = (
            self.size[0] - self.notch[0],
            *(0.0 for _ in depth),
            self.size[-1] - self.notch[1],
        )
        notch = self.cuboid(occ, corner, (self.notch[0], *depth, self.notch[1]))
        parts, _ = occ.cut([(self.dim, block)], [(self.dim, notch)])
        return {"body": [tag for _, tag in parts]}

    def facet_name(self, centre: Point, region: str) -> str:
        """The name of the side; the height distinguishes the two sides of the notch."""
        inner = self.at(centre[self.dim - 1], self.size[-1] - self.notch[1])
        return self.side(centre) or ("inner_horizontal" if inner else "inner_vertical")


@dataclass(frozen=True, kw_only=True)
class Punch(Box):
    """A block whose top has a contact part, which a punch may touch, and a free part.

    ``size`` is the size of the part x > 0 (and y > 0). Facets: contact (on top, with x, y <
    half_width), top (the rest of the top), symmetry (x = 0), right, in 3D symmetry_y (y = 0) and
    back, bottom. The contact zone is around contact. The gap of a flat punch is minus its depth;
    the gap of a rounded punch adds the profile.
    """

    half_width: float = parameter(0.25, "length", "half-width of the punch: contact ends there")

    contact_names = ("contact",)

    def validate(self) -> None:
        super().validate()
        below("half_width", self.half_width, min(self.size[:-1]), "the width of the block kept")
        at_most("h_contact", self.finest, self.half_width, "half_width")

    @property
    def facet_names(self) -> tuple[str, ...]:
        sides = ("symmetry_y", "back") if self.dim == 3 else ()
        return ("symmetry", "right", *sides, "bottom", "top", "contact")

    @property
    def zone(self) -> Zone:
        """Two layers of elements below and beside the punch."""
        margin = 2 * self.finest
        box = self.limits(lower=self.size[-1] - margin)
        for axis in "XY"[: self.dim - 1]:
            box[f"{axis}Max"] = self.half_width + margin
        reach = self.half_width + margin + self.finest / GROWTH / 2
        return Zone("Box", box, reach ** (self.dim - 1) * (margin + self.transition))

    def shape(self, occ: Any) -> dict[str, list[int]]:
        """The block, with the top divided at the end of the punch."""
        (body,) = super().shape(occ)["body"]
        a, height = self.half_width, self.size[-1]
        if self.dim == 2:
            cut = (0, occ.addPoint(a, height, 0))
        else:
            cut = (2, occ.addRectangle(0, 0, height, a, a))
        _, (parts, _) = occ.fragment([(self.dim, body)], [cut])
        return {"body": [tag for _, tag in parts]}

    def facet_name(self, centre: Point, region: str) -> str:
        """The name of the side; the position distinguishes contact and top."""
        name = self.side(centre)
        # The centre of the free part is outside the punch in one direction at least.
        if name == "top" and all(x < self.half_width for x in centre[: self.dim - 1]):
            return "contact"
        return {"left": "symmetry", "front": "symmetry_y"}.get(name, name)


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
