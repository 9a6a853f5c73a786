"""The last iterate of the interior point method, from which solutions are differentiated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from contact_locking.arrays import FloatArray

# The points x of a family and their multipliers z.
Pair: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class LastIterate:
    """Local displacements, ghosts included, travels of tools, and a pair (x, z) for each family.

    A family that takes no part, as all do not where the body is elastic, has None.
    """

    displacement: FloatArray
    travels: tuple[float, ...]
    cones: tuple[Pair | None, ...]
