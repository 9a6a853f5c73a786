"""Print what a run takes beside its solve: seconds and memory, stage by stage.

    ./in-env mpirun -n 2 python3 benchmarks/stages.py --h 1/24 --n inf
    ./in-env python3 benchmarks/stages.py --file body.xdmf --n 1e4

The case is the unit block of the tests on a regular grid, mu = 0.3, solved with multigrid, written
without a picture.  ``--file`` gives another mesh of a body with the same names of boundary parts.
The memory of a stage is the largest resident memory during the stage, as a sum over all ranks and
in the rank with most; it contains what earlier stages have left.  Times are by the clock
on the wall.
"""

from __future__ import annotations

import argparse
import gc
import math
import re
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

from mpi4py import MPI

from contact_locking._version import __version__
from contact_locking.results.solution import StudySolution
from contact_locking.running import run as writing
from contact_locking.running.assembly import assemble, mesh_of
from contact_locking.running.solving import SolvableStudy
from contact_locking.study_file.parameters import Parameters
from contact_locking.view import report

# The reference problem belongs to the tests.
sys.path.append(str(Path(__file__).resolve().parent.parent / "tests/support"))
from problems import block

COMM = MPI.COMM_WORLD
# Writing 5 here sets the largest resident memory to the present one.
_CLEAR, _STATUS = Path("/proc/self/clear_refs"), Path("/proc/self/status")
#: The stages that the solve is compared with.
AFTER = ("certificate, fields and summary", "files", "report")


class Row(NamedTuple):
    """Seconds, the memory of all ranks at the start, and the largest of each rank, in GB."""

    seconds: float
    before: float
    most: list[float]


class Stages:
    """What each stage took."""

    def __init__(self) -> None:
        self.rows: dict[str, Row] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the block; collective."""
        gc.collect()
        COMM.Barrier()
        _CLEAR.write_text("5")
        before, began = COMM.allreduce(_memory("VmRSS")), time.perf_counter()
        yield
        COMM.Barrier()
        seconds = time.perf_counter() - began
        self.rows[name] = Row(seconds, before, COMM.allgather(_memory("VmHWM")))

    def table(self) -> str:
        """The stages as a table, and what those after the solve take of the solve."""
        solve = self.rows["solve"]
        lines = ["| stage | s | share of the solve | GB before | GB | GB in a rank |"]
        lines.append("| --- | --- | --- | --- | --- | --- |")
        for name, row in self.rows.items():
            share = f"{100.0 * row.seconds / solve.seconds:.1f} %"
            memory = f"{row.before:.3f} | {sum(row.most):.3f} | {max(row.most):.3f}"
            lines.append(f"| {name} | {row.seconds:.2f} | {share} | {memory} |")
        after = sum(self.rows[name].seconds for name in AFTER)
        peak = max(sum(self.rows[name].most) for name in AFTER)
        lines += [
            "",
            f"After the solve: {100.0 * after / solve.seconds:.1f} % of its time, and a memory of "
            f"{100.0 * peak / sum(solve.most):.0f} % of that of the solve.",
        ]
        return "\n".join(lines)


def _memory(name: str) -> float:
    """A resident memory of this process in GB, at present or the largest."""
    found = re.search(rf"{name}:\s+(\d+) kB", _STATUS.read_text(encoding="utf-8"))
    assert found is not None
    return int(found[1]) / 2**20


def run(parameters: Parameters, folder: Path) -> Stages:
    """Mesh, assemble, solve, certify, write and report; collective."""
    stages = Stages()
    solution = solved(parameters, stages)
    with stages.stage("files"):
        writing.write(solution, folder)
    with stages.stage("report"):
        if COMM.rank == 0:
            report.write(folder)
    return stages


def solved(parameters: Parameters, stages: Stages) -> StudySolution:
    """The solution, as `solving.solve` makes it; collective."""
    with stages.stage("mesh"):
        domain = mesh_of(parameters, COMM)
    with stages.stage("assembly"):
        problem = assemble(parameters, COMM, domain)
        study = SolvableStudy(problem)
    with stages.stage("solve"):
        report = study.solver.solve()
    with stages.stage("certificate, fields and summary"):
        solution = study.solution(study.solver.state(report)).with_entries(version=__version__)
        study.close()
    return solution


def case(h: Fraction, n: float, degree: int, file: Path | None = None) -> Parameters:
    """The block on a regular grid, or the body in a file; without a picture."""
    changes: dict[str, Any] = {"penalty__n": n, "solver__linear": "iterative"}
    changes["output__picture"] = False
    if degree == 2:
        changes["discretisation__degree"] = 2
    if file is None:
        changes["mesh__structured"] = True
    else:
        changes["mesh"] = {"file": str(file)}
    return block(3, float(h), **changes)


def main() -> None:
    """Compile the forms with a small run, and do the large one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--h", type=Fraction, default=Fraction(1, 16), help="such as 1/24")
    parser.add_argument("--n", type=float, default=math.inf)
    parser.add_argument("--degree", type=int, choices=(1, 2), default=1)
    parser.add_argument("--file", type=Path, help="a mesh file in place of the grid")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as root:
        # All ranks write to the folder of rank 0.
        place = Path(COMM.bcast(root))
        run(case(Fraction(1, 3), given.n, given.degree), place / "small")
        stages = run(case(given.h, given.n, given.degree, given.file), place / "large")
        size = sum(path.stat().st_size for path in (place / "large").rglob("*") if path.is_file())
        COMM.Barrier()
    if COMM.rank == 0:
        print(
            f"h = {given.h}, n = {given.n:g}, degree {given.degree}, {COMM.size} ranks, "
            f"{size / 2**20:.1f} MB of files\n\n{stages.table()}"
        )


if __name__ == "__main__":
    main()
