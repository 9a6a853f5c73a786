"""Tables of numbers, which expressions interpolate linearly."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

# An argument may lie outside of the table by this share of its range, which is rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Table:
    """The values at ascending points, and linear between two points.

    Outside of its points a table has no value.  Two tables are equal only if they are one.
    """

    name: str
    points: npt.NDArray[np.float64]
    values: npt.NDArray[np.float64]

    def __call__(self, argument: Any) -> Any:
        """The values at the given arguments, NaN where the table has none."""
        low, high = self.points[0], self.points[-1]
        room = _ROUNDING * (high - low)
        inside = (argument >= low - room) & (argument <= high + room)
        return np.where(inside, self.clamped(argument), np.nan)

    def clamped(self, argument: Any) -> Any:
        """The values at the given arguments, outside of the points that of the nearest point."""
        return np.interp(argument, self.points, self.values)

    def slope(self, argument: Any) -> Any:
        """The derivatives at the given arguments, at a point of the table the one to its right."""
        slopes = np.diff(self.values) / np.diff(self.points)
        place = np.searchsorted(self.points, argument, side="right") - 1
        return slopes[np.clip(place, 0, len(slopes) - 1)]

    def __str__(self) -> str:
        """The name and the range of the table."""
        return f"table '{self.name}' has values from {self.points[0]:.6g} to {self.points[-1]:.6g}"


class AnyTable(Mapping[str, Table]):
    """A table without values for every name, where the tables are not known yet."""

    def __getitem__(self, name: str) -> Table:
        return Table(name, np.empty(0), np.empty(0))

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str)

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0


NO_TABLES: Mapping[str, Table] = {}
ANY_TABLE = AnyTable()
