"""Discretisation, penalty, solver, steps, adaptive meshes, certificate, derivatives and output."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, field_validator

from contact_locking.values.concept import Concept, Fault, Place, entry
from contact_locking.values.kinds import (
    Count,
    Degree,
    Names,
    Number,
    Point,
    Positive,
    PositiveOrInfinite,
    Share,
    StepCount,
    Switch,
    Text,
    Tolerance,
)
from contact_locking.values.wording import show

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


# Linux's PATH_MAX is 4096, and the names of the files are appended to the folder.
_LONGEST_PATH = 3900


class DiscretisationParameters(Concept):
    """The element: the degree of the displacements."""

    degree: Degree = entry(
        1, "degree of the displacements in each cell: 1, as in the theorems of the paper, or 2", "1"
    )


class PenaltyParameters(Concept):
    """n of the locking penalty R_n (23), epsilon of contact and friction (22), (25)."""

    n: PositiveOrInfinite = entry(
        math.inf, "locking penalty; .inf: the variational inequality itself", "stress"
    )
    epsilon: Positive | None = entry(
        None, "compliance of the foundation, 1/epsilon is the penalty; null: 1/n", "length/stress"
    )

    @property
    def compliance(self) -> float:
        """``epsilon``, which is ``1/n`` unless it is given."""
        return 1.0 / self.n if self.epsilon is None else self.epsilon


class CertificateParameters(Concept):
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


class EquilibriaParameters(Concept):
    """Several solutions of one problem with friction."""

    find: Count = entry(
        5,
        "the most solutions, with the first; those beside it are in folders equilibrium_2, ...",
        "1",
    )


class BranchesParameters(Concept):
    """A branch of solutions over a share of the friction coefficient or of loads.

    Over the friction coefficient it begins with none of it, over loads with those of the file.
    """

    over: Text = entry(
        "friction.coefficient",
        "what the branch multiplies by a share: friction.coefficient, loads (all of them, with "
        "prescribed displacements), or the key of some of them, such as loads.tractions.0.value",
    )
    to: Positive = entry(2.0, "the last share", "1")

    @property
    def is_over_friction(self) -> bool:
        return self.over == "friction.coefficient"


_MOST_CHARTS = 20


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
        found = {
            "length": length,
            "force": f"{force}/{length}" if per_thickness else force,
            "stress": self.stress or f"{force}/{length}²",
            "area": length if per_thickness else f"{length}²",
            "energy": force if per_thickness else f"{force}·{length}",
            "force · length": force if per_thickness else f"{force}·{length}",
        }
        return found if self.time is None else {**found, "time": self.time}


class ChartParameters(Concept):
    """A chart of the report: a column of history.csv over another, a curve for each case."""

    x: Text = entry(..., "a column of history.csv, or an expression of columns, as 1.2*t")
    y: Text = entry(..., "a column of history.csv, or an expression, as -contact_force_top_y")


class OutputParameters(Concept):
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
    charts: Annotated[tuple[ChartParameters, ...], Field(max_length=_MOST_CHARTS)] = entry(
        (), "charts of history.csv in the report, such as {x: motion_top_y, y: contact_force_top_y}"
    )

    def _faults(self) -> Iterator[Fault]:
        count = sum(probe.count for probe in self.probes)
        if count > MOST_POINTS:
            yield Fault(("probes",), f"{count} points; at most {MOST_POINTS}")

    @field_validator("directory")
    @classmethod
    def _some_folder(cls, directory: str) -> str:
        if not directory.strip() or "\0" in directory:
            raise ValueError("must name a folder")
        if len(directory.encode()) > _LONGEST_PATH:
            raise ValueError(f"must have at most {_LONGEST_PATH} bytes")
        return directory


class AdaptParameters(Concept):
    """The loop that solves, estimates the error, marks cells and refines them."""

    tolerance: Tolerance = entry(
        0.01,
        "the relative error (certificate.errors.mesh) at which the meshes are fine enough",
        "1",
    )
    share: Share = entry(0.5, "the share of the squared error that the marked cells have", "1")
    max_dofs: Count = entry(100_000, "no mesh has more unknowns", "1")
    max_meshes: Count = entry(12, "no more meshes, with the first", "1")


_MOST_STEPS = 100_000


class StepParameters(Concept):
    """Times t_1 < t_2 < ..., with steps of equal length or listed."""

    to: Positive | None = entry(None, "the last time, for steps of equal length from t = 0", "time")
    count: StepCount | None = entry(None, "number of steps up to `to`", "1")
    times: Annotated[tuple[Number, ...], Field(max_length=_MOST_STEPS)] | None = entry(
        None, "the times in place of `to` and `count`, ascending", "time"
    )
    least: Positive | None = entry(
        None,
        "the shortest step: a step that does not converge is halved down to this length; "
        "null: 1/64 of the step, and 1/8 where a proof says that nothing can follow the step",
        "time",
    )
    on_failure: Literal["fail", "stop"] = entry(
        "fail",
        "where the least step fails: fail (the state that it reached, exit code 3), or stop (the "
        "last step that was solved is the result)",
    )

    @property
    def planned(self) -> tuple[float, ...]:
        """The times t_1 < t_2 < ... of the steps."""
        if self.times is not None:
            return self.times
        assert self.to is not None and self.count is not None
        return tuple(self.to * k / self.count for k in range(1, self.count + 1))

    @property
    def start(self) -> float:
        """The time before the first step: 0, or ``t_1`` if that is earlier."""
        return min(0.0, self.planned[0])

    def _faults(self) -> Iterator[Fault]:
        if self.times is None:
            if self.to is None or self.count is None:
                yield Fault((), "give `to` and `count`, such as {to: 1, count: 20}, or `times`")
        elif self.to is not None or self.count is not None:
            yield Fault(("times",), "give either `times`, or `to` and `count`")
        elif not self.times:
            yield Fault(("times",), "must have one time at least")
        else:
            for first, second in itertools.pairwise(self.times):
                if not first < second:
                    message = f"must ascend, but {show(second)} follows {show(first)}"
                    yield Fault(("times",), message)
                    return


class SensitivityParameters(Concept):
    """How quantities of the solution change with numbers of the file, by its last tangent."""

    of: Names = entry(
        ("compliance",),
        "the quantities, as contact_force.1, reactions.top.1, compliance or pressure_max",
    )
    to: Names = entry((), "the numbers, by their dotted keys, as friction.coefficient")
    check: Switch = entry(
        False, "compare with central differences, which take two more solves for each number"
    )
