"""The criteria of a solution, each a relative value with a limit.

Forces are relative to the acting forces, work to the elastic energy, and the change of the friction
bound to the friction bound.  A criterion whose value is NaN does not hold.
"""

from __future__ import annotations

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
