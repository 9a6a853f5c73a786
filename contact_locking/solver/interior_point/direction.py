"""A step of the displacement together with the steps of the families of cones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.family import Family, Step


@dataclass(frozen=True)
class Direction:
    """A step of the displacement with the travels, and of every family that takes part."""

    displacement: FloatArray
    steps: Mapping[Family, Step]

    def plus(self, other: Direction, share: float) -> Direction:
        """The direction plus ``share`` times the other."""
        return Direction(
            self.displacement + share * other.displacement,
            {family: step.plus(other.steps[family], share) for family, step in self.steps.items()},
        )

    def between(self, other: Direction, share: float) -> Direction:
        """The direction plus ``share`` times what leads from it to the other."""
        if share == 1.0:
            return other
        return Direction(
            self.displacement + share * (other.displacement - self.displacement),
            {
                family: step.between(other.steps[family], share)
                for family, step in self.steps.items()
            },
        )
