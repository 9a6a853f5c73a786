"""The block: a rectangle or a box."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from .geometry import GROWTH, Geometry, Point, Zone, dimension, length, parameter, vector


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
        given = default if getattr(self, name) in (None, (), []) else getattr(self, name)
        numbers = tuple(check(name, x) for x in vector(name, given, len(default)))
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
