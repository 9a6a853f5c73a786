"""Tables of numbers, by arrays or in CSV files, as functions of one argument."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from contact_locking.arrays import LARGEST, FloatArray
from contact_locking.errors import InputError, with_key
from contact_locking.files.readable import number_at, place_of, rows_of

# An argument may lie outside of the table by this share of its range, which is rounding.
_ROUNDING = 1e-9


class Tabulated:
    """``f(argument)``, linear between ascending points; it has no value beyond them.

    A script may give a table wherever it may give a number or an expression, as in
    ``Traction("top", [0, Tabulated([0, 1], [0, -0.1])])``.  Two tables are equal only if they are
    one.

    Parameters
    ----------
    points
        the ascending arguments (k,), at least two
    values
        f (k,) at the points
    argument
        the expression that is the argument: the time ``t``, the slip ``s``, ``2*x``
    name
        the name in messages

    Raises
    ------
    InputError
        for arrays that are no table
    """

    def __init__(
        self,
        points: npt.ArrayLike,
        values: npt.ArrayLike,
        argument: str = "t",
        name: str = "",
    ) -> None:
        self.points, self.values = _numbers(points, "points"), _numbers(values, "values")
        self.argument, self.name = argument, name
        if len(self.points) != len(self.values):
            raise InputError("must be one number for each point", "Tabulated.values")
        if not np.all(steps := np.diff(self.points) > 0.0):
            after = int(np.argmin(steps))
            message = f"must ascend, but {self.points[after + 1]:g} follows {self.points[after]:g}"
            raise InputError(message, "Tabulated.points")

    @classmethod
    def read(
        cls, file: str | Path, over: str, column: str, argument: str = "t", name: str = ""
    ) -> Tabulated:
        """The table of two columns of a CSV file, whose first row has the names of the columns.

        ``over`` is the column of the points, and ``column`` that of the values.  Raises InputError
        with one of these keys for a file that cannot be used.
        """
        path = Path(file)
        with rows_of(path, "file") as rows:
            header = [title.strip() for title in next(rows, [])]
            places = [
                with_key(key, partial(place_of, title, header, path))
                for key, title in (("over", over), ("column", column))
            ]
            filled = (row for row in rows if any(cell.strip() for cell in row))
            pairs = [[number_at(place, row)[0] for place in places] for row in filled]
        points, values = np.array(pairs, dtype=float).reshape(-1, 2).T
        try:
            return cls(points, values, argument, name)
        except InputError as error:
            is_over = str(error.key).endswith("points")
            raise InputError(f"{file}: {error}", "over" if is_over else "column") from None

    def __call__(self, argument: Any) -> Any:
        """The values at arguments, NaN where the table has none."""
        low, high = self.points[[0, -1]]
        room = _ROUNDING * (high - low)
        inside = (argument >= low - room) & (argument <= high + room)
        return np.where(inside, self.clamped(argument), np.nan)

    def clamped(self, argument: Any) -> Any:
        """The values at arguments, beyond the points that of the nearest point."""
        return np.interp(argument, self.points, self.values)

    def slope(self, argument: Any) -> Any:
        """The derivatives at arguments, at a point of the table the one to its right."""
        slopes = np.diff(self.values) / np.diff(self.points)
        place = np.searchsorted(self.points, argument, side="right") - 1
        return slopes[np.clip(place, 0, len(slopes) - 1)]

    def __str__(self) -> str:
        low, high = self.points[[0, -1]]
        name = f" '{self.name}'" if self.name else ""
        return f"table{name} has values from {low:.6g} to {high:.6g}"


def _numbers(data: npt.ArrayLike, key: str) -> FloatArray:
    try:
        array = np.array(data, dtype=float)
    except (TypeError, ValueError):
        raise InputError("must be numbers (k,)", f"Tabulated.{key}") from None
    if array.ndim != 1 or len(array) < 2:
        raise InputError("must be at least 2 numbers (k,)", f"Tabulated.{key}")
    if not np.all(is_number := np.abs(array) <= LARGEST):
        message = f"must be numbers of at most {LARGEST:g}, and number {np.argmin(is_number) + 1}"
        raise InputError(f"{message} is {array[np.argmin(is_number)]:g}", f"Tabulated.{key}")
    return array
