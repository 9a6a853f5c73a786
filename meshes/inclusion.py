"""A block with a round inclusion of another material."""

from dataclasses import dataclass
from typing import Any

from .block import Box
from .curved import Curved
from .geometry import parameter, real


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
        if self.h > self.radius:
            raise ValueError(
                f"h: {self.h:g} is more than the radius of the inclusion, {self.radius:g}"
            )
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
