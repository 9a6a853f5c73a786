"""Results in files: which are written, their names, and the folder, where one run is at a time."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

from pydantic import Field, field_validator

from contact_locking import files
from contact_locking.errors import InputError, explained
from contact_locking.files import locked, new_folders
from contact_locking.values.concept import Concept, Fault, Place, entry
from contact_locking.values.kinds import Point, Switch, Text

if TYPE_CHECKING:
    from mpi4py import MPI

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
        "results", "folder of the results; null: results/ and the name of the study file"
    )
    fields: Switch = entry(True, "whether to write the fields for ParaView")
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


T = TypeVar("T")

#: The first line of every file with the parameters of a run or of a study.
HEADER = "# All parameters, written by contact_locking\n"
#: The key of the study file with the folder.
KEY = "output.directory"
SUMMARY, PARAMETERS, FIELDS = "summary.json", "parameters.yaml", "fields.vtkhdf"
#: A row of numbers for each step of a process.
HISTORY = "history.csv"
CONTACT, FACETS = "contact.csv", "contact_facets.csv"
#: The fields at the points of the probes.
PROBES = "probes.csv"
#: The points of a branch of solutions.
BRANCHES = "branches.csv"
#: The picture of a run.
PICTURE = "picture.png"
#: A fit to measured curves: its numbers, and the picture of data and model.
FIT, FIT_PICTURE = "fit.json", "fit.png"
#: The report of a run or a study: its page, which a new run makes out of date, and its charts.
PAGE, CHARTS = "report.html", "report"
#: The folder of the saved state, and the file in it that says of what.
CHECKPOINT, RECORD = "checkpoint", "record.json"
#: All of a run in the order in which they are put in place: a folder with a summary has the others.
FILES_OF_RUN = (
    *(PARAMETERS, CONTACT, FACETS, HISTORY, FIELDS, PROBES),
    *(BRANCHES, PICTURE, FIT, FIT_PICTURE, PAGE, CHECKPOINT, SUMMARY),
)
#: More than the bytes of a summary, the parameters and some hundred contact points.
TEXTS_BYTES = 65_536
#: The table of a study, in CSV and in JSON lines.
TABLE_CSV, TABLE_LINES = "table.csv", "table.jsonl"


def folder_of(number: int) -> str:
    """The folder of solution 2, 3, ... below that of the first."""
    return f"equilibrium_{number}"


def not_writable(directory: object) -> str:
    """The message about a folder that results cannot be written to, with a long path shortened."""
    path = str(directory)
    shown = path if len(path) <= 300 else f"{path[:200]}...{path[-80:]}"
    return f"results cannot be written to {shown}"


def require_own(directory: Path, names: Sequence[str] = FILES_OF_RUN) -> None:
    """Raise InputError if results would replace files that no run or study has written; OSError.

    In the folder of an earlier run or study, which its parameters tell, or else its summary,
    results replace all files of their names; elsewhere they replace a saved state only.
    """
    for name, mark in ((PARAMETERS, HEADER), (SUMMARY, '"friction_fixed_point": {')):
        path = directory / name
        if path.is_file() and mark.encode() in path.read_bytes():
            return
    for path in [directory / name for name in names]:
        if os.path.lexists(path) and not (path / RECORD).is_file():
            raise InputError(
                f"{path}: was not written by an earlier run, and would be replaced; move it away, "
                "or write to another folder",
                KEY,
            )


@contextlib.contextmanager
def reserved(directory: str | Path, comm: MPI.Intracomm) -> Iterator[None]:
    """Keep ``directory`` for the results of one run; collective.

    Enter the block before the solve, which may take hours.  The unfinished files of a killed run
    are removed, and a new folder is removed again if no file is written.  Raises the errors of
    `prepare`, and InputError if another run or a study writes to the folder.
    """
    target = Path(directory)
    with contextlib.ExitStack() as stack:

        def attempt() -> None:
            stack.enter_context(new_folders(target))
            stack.enter_context(locked(target, "run"))
            files.remove_abandoned(target)
            require_own(target)
            _require_writable(target)

        on_root_of(comm, target, attempt)
        yield


def prepare(directory: str | Path, comm: MPI.Intracomm) -> None:
    """Raise InputError if results cannot be written to ``directory``; leave no trace; collective.

    Raises ContactLockingError if the disk has no room for the text files.
    """
    target = Path(directory)

    def attempt() -> None:
        with new_folders(target):
            require_own(target)
            _require_writable(target)

    on_root_of(comm, target, attempt)


def on_root_of(comm: MPI.Intracomm, directory: Path, work: Callable[[], T]) -> T:
    """`on_root` with an error about the folder in place of an OSError; collective."""
    # Study files are read without MPI.
    from contact_locking.parallel import on_root

    def attempt() -> T:
        with explained_in(directory):
            return work()

    return on_root(comm, attempt)


def explained_in(directory: Path) -> contextlib.AbstractContextManager[None]:
    """Raise an error about the folder of the results in place of an OSError."""
    return explained(not_writable(directory), directory, KEY)


def _require_writable(directory: Path) -> None:
    """Raise OSError if the folder has no room for the text files; leave no trace."""
    with files.staging(directory) as folder:
        files.require_room(folder, TEXTS_BYTES)
