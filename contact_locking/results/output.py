"""The files of the results: which are written, and what they show."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, field_validator

from contact_locking.values.concept import Concept, Fault, Place, entry
from contact_locking.values.kinds import Point, Switch, Text

# Linux's PATH_MAX is 4096, and the names of the files are appended to the folder.
_LONGEST_PATH = 3900
_MOST_CHARTS = 20
#: The table has a row for each point, and for each step of a process.
MOST_POINTS = 10_000

_PointCount = Annotated[int, Field(strict=True, ge=2, le=MOST_POINTS)]


class Line(Concept):
    """Equally spaced points on the segment between two points, both ends included."""

    start: Point = entry(..., "the first point", "length", alias="from")
    to: Point = entry(..., "the last point", "length")
    count: _PointCount = entry(..., "number of points, both ends included", "1")

    @property
    def points(self) -> tuple[tuple[float, ...], ...]:
        """The points from the first to the last."""
        shares = [number / (self.count - 1) for number in range(self.count)]
        ends = list(zip(self.start, self.to, strict=True))
        return tuple(tuple((1.0 - s) * a + s * b for a, b in ends) for s in shares)


class Probe(Concept):
    """Points of the body at rest; exactly one of the keys."""

    points: Annotated[tuple[Point, ...], Field(max_length=MOST_POINTS)] | None = entry(
        None, "points of the body, each a list of coordinates", "length"
    )
    line: Line | None = entry(None, "points on a line")

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


class UnitLabels(Concept):
    """What the units of the file are called in terminal, report and charts; nothing is converted.

    Those of stress, area, moment and energy follow from length and force.
    """

    length: Text = entry(..., "the label of lengths, as mm")
    force: Text = entry(..., "the label of forces, as N, also in 2D, where results are N/mm")
    stress: Text | None = entry(None, "the label of stresses, as MPa; null: force/length²")
    time: Text | None = entry(None, "the label of the time t of steps")

    def labels(self, per_thickness: bool) -> dict[str, str]:
        """The label of each unit; ``per_thickness`` says that results are those of a plane body."""
        length, force = self.length, self.force
        labels = {
            "length": length,
            "force": f"{force}/{length}" if per_thickness else force,
            "stress": self.stress or f"{force}/{length}²",
            "area": length if per_thickness else f"{length}²",
            "energy": force if per_thickness else f"{force}·{length}",
            "force · length": force if per_thickness else f"{force}·{length}",
        }
        return labels if self.time is None else {**labels, "time": self.time}


class Chart(Concept):
    """A chart of the report: a column of history.csv over another, a curve for each case."""

    x: Text = entry(..., "a column of history.csv, or an expression of columns, as 1.2*t")
    y: Text = entry(..., "a column of history.csv, or an expression, as -contact_force_top_y")


class Output(Concept):
    """The files with the results."""

    directory: Text = entry(
        "results", "folder of the results; of a file without one results/ and the name of the file"
    )
    fields: Switch = entry(True, "whether to write the fields for ParaView")
    formats: tuple[Literal["vtx", "xdmf"], ...] = entry(
        ("vtx",),
        "the files of the fields: vtx (fields.bp, for ParaView 5.11 or newer, or 5.12 for more "
        "than 0.5 GB), xdmf (fields.xdmf, for tools that do not read VTX), or both",
    )
    picture: Switch = entry(True, "whether to draw a picture")
    probes: tuple[Probe, ...] = entry(
        (), "points where probes.csv has displacement, strain norm and stresses"
    )
    units: UnitLabels | None = entry(None, "labels of the units, as {length: mm, force: N}")
    charts: Annotated[tuple[Chart, ...], Field(max_length=_MOST_CHARTS)] = entry(
        (), "charts of history.csv in the report, such as {x: motion_top_y, y: contact_force_top_y}"
    )

    def _faults(self) -> Iterator[Fault]:
        count = sum(probe.count for probe in self.probes)
        if count > MOST_POINTS:
            yield Fault(("probes",), f"{count} points; at most {MOST_POINTS}")

    def labels(self, dim: int, axisymmetric: bool) -> dict[str, str]:
        """The label of each unit in results of a body; empty without labels."""
        return {} if self.units is None else self.units.labels(dim == 2 and not axisymmetric)

    @field_validator("directory")
    @classmethod
    def _some_folder(cls, directory: str) -> str:
        if not directory.strip() or "\0" in directory:
            raise ValueError("must name a folder")
        if len(directory.encode()) > _LONGEST_PATH:
            raise ValueError(f"must have at most {_LONGEST_PATH} bytes")
        return directory


class Extras(Concept):
    """Checks of the results that cost extra solves, in addition to those of every run."""

    constants: Switch = entry(
        False, "c_0 by an eigenvalue problem, and whether theory excludes a second solution"
    )
    limit: Switch = entry(
        False, "solve for n = .inf on the same mesh too, and measure the distance to its solution"
    )
    error_bound: Switch = entry(
        False,
        "a proved bound of the error of mesh and penalty in the energy norm, for the friction "
        "bound of the solution; in 2D",
    )
    critical_friction: Switch = entry(
        False,
        "the least multiple of the friction coefficient at which the linearised problem at the "
        "solution is singular, by the eigenvalues on Gamma_C",
    )
