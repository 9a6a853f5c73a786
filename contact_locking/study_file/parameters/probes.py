"""Probes: points of the body where the fields are written to a table."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from .base import Fault, Place, Section, entry
from .values import Number

#: The table has a row for each point, and for each step of a process.
MOST_POINTS = 10_000

_PointCount = Annotated[int, Field(strict=True, ge=2, le=MOST_POINTS)]


class Line(Section):
    """Equally spaced points on the segment between two points, both ends included."""

    start: tuple[Number, ...] = entry(..., "the first point", "length", alias="from", vector=True)
    to: tuple[Number, ...] = entry(..., "the last point", "length", vector=True)
    count: _PointCount = entry(..., "number of points, both ends included", "1")

    @property
    def points(self) -> tuple[tuple[float, ...], ...]:
        """The points from the first to the last."""
        shares = [number / (self.count - 1) for number in range(self.count)]
        ends = list(zip(self.start, self.to, strict=True))
        return tuple(tuple((1.0 - s) * a + s * b for a, b in ends) for s in shares)


class Probe(Section):
    """Points of the body at rest; exactly one of the keys."""

    points: Annotated[tuple[tuple[Number, ...], ...], Field(max_length=MOST_POINTS)] | None = entry(
        None,
        "points of the body, each a list of coordinates",
        "length",
        optional=True,
        vectors=True,
    )
    line: Line | None = entry(None, "points on a line", optional=True)

    def _faults(self) -> Iterator[Fault]:
        if (self.points is None) == (self.line is None):
            yield Fault((), "give exactly one of points and line")
        line = self.line
        if line is not None and len(line.start) != len(line.to):
            message = f"must have {len(line.start)} coordinates as from, not {len(line.to)}"
            yield Fault(("line", "to"), message)

    @property
    def count(self) -> int:
        """The number of points."""
        return self.line.count if self.line is not None else len(self.points or ())

    def places(self) -> Iterator[tuple[Place, tuple[float, ...]]]:
        """Each point with the key that defines the point, relative to the probe."""
        if self.line is not None:
            yield from ((("line",), point) for point in self.line.points)
        for number, point in enumerate(self.points or ()):
            yield ("points", number), point
