"""The criteria of a solution, each a relative value with a limit.

Forces are relative to the acting forces, work to the elastic energy, and the change of the friction
bound to the friction bound.  A criterion whose value is NaN does not hold.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Criterion:
    """A measured value that must not exceed its limit; ``meaning`` completes "the ... is"."""

    value: float
    limit: float
    meaning: str

    @property
    def holds(self) -> bool:
        return bool(self.value <= self.limit)

    def summary(self) -> dict[str, Any]:
        return {"value": self.value, "limit": self.limit, "holds": self.holds}

    def complaint(self) -> str:
        return f"the {self.meaning} is {self.value:.1e}, above {self.limit:g}"


def complaints(criteria: Mapping[str, Criterion]) -> str:
    """The criteria that do not hold, in words; empty if all hold."""
    return "; ".join(item.complaint() for item in criteria.values() if not item.holds)
