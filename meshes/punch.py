"""Half of a block, in 3D a quarter, under a punch on the plane of symmetry."""

from dataclasses import dataclass
from typing import Any

from .block import Box
from .geometry import GROWTH, Point, Zone, parameter


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
        if self.half_width >= min(self.size[:-1]):
            raise ValueError(
                f"half_width: {self.half_width:g} is not less than the width of the block kept, "
                f"{min(self.size[:-1]):g}"
            )
        if self.finest > self.half_width:
            raise ValueError(
                f"half_width: {self.half_width:g} is less than one element of size "
                f"{self.finest:g}; make h_contact smaller"
            )

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
