"""The L-shaped block, with a re-entrant edge."""

import math
from dataclasses import dataclass
from typing import Any

from .block import Box
from .geometry import Point, length, parameter


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
