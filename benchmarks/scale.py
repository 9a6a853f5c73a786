"""Solve one large block in 3D on every rank of mpirun, and print a table of what it took.

    ./in-env mpirun -n 2 python3 benchmarks/scale.py --h 1/64 --n 1e4
    ./in-env mpirun -n 2 python3 benchmarks/scale.py --h 1/64 --n inf
    ./in-env mpirun -n 2 python3 benchmarks/scale.py --h 1/64 --n inf --filter-limit 600000
    ./in-env mpirun -n 8 python3 benchmarks/scale.py --h 1/24 --n inf --filter-limit 0

The case is the unit block of the tests on a regular grid, mu = 0.3.  ``--filter-limit`` sets the
most unknowns that the filter factorises: 0 leaves everything to the projection.  GMRES
iterations are per linear solve.  Times are by the clock on the wall.  Where there are more ranks
than cores, the counts mean something and the times do not.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import sys
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

from mpi4py import MPI

from contact_locking.running import solving
from contact_locking.solver.ksp import FILTER_LIMIT
from contact_locking.solver.multigrid import Filter, FilteredMultigrid, Projection
from contact_locking.solver.tangent_solver import MultigridTangents
from contact_locking.study_file.parameters import Parameters

# The reference problem belongs to the tests.
sys.path.append(str(Path(__file__).resolve().parent.parent / "tests/support"))
from problems import block
from stopwatch import WallClock


class Tangents(WallClock):
    """Notes for each tangent how it is preconditioned, its GMRES iterations and its seconds."""

    def __init__(self) -> None:
        super().__init__()
        #: What preconditions, seconds of its set-up and of solves, and the iterations of solves.
        self.rows: list[tuple[str, list[float], list[int]]] = []
        given = MultigridTangents
        self._watch(given.refresh, given.solve)

    def _watch(self, refresh: Callable[..., None], solve: Callable[..., None]) -> None:
        def refresh_and_note(solver: MultigridTangents, *given: Any) -> None:
            self.print_last()
            began = time.perf_counter()
            self.rows.append(("", [0.0, 0.0], []))
            refresh(solver, *given)
            self.rows[-1][1][0] += time.perf_counter() - began

        def solve_and_note(solver: MultigridTangents, *given: Any, **named: Any) -> None:
            began, before = time.perf_counter(), solver.counts.linear
            solve(solver, *given, **named)
            _, seconds, counts = self.rows[-1]
            counts.append(solver.counts.linear - before)
            seconds[1] += time.perf_counter() - began
            self.rows[-1] = (preconditioner(solver._multigrid), seconds, counts)

        MultigridTangents.refresh = refresh_and_note  # type: ignore[method-assign,assignment]
        MultigridTangents.solve = solve_and_note  # type: ignore[method-assign,assignment]

    def print_last(self) -> None:
        """Print the row of the last tangent, on the first rank."""
        if not self.rows or MPI.COMM_WORLD.rank > 0:
            return
        kind, (set_up, solves), counts = self.rows[-1]
        listed = ", ".join(map(str, counts))
        number = len(self.rows) - 1
        print(f"| {number} | {kind} | {set_up:.1f} | {solves:.1f} | {listed} |", flush=True)


def preconditioner(multigrid: FilteredMultigrid) -> str:
    """What a tangent is solved with at present, and with how many rows to factorise."""
    helper = multigrid.helper
    if isinstance(helper, Projection):
        return f"projection, {helper._rows.getSize()[0]}"
    if isinstance(helper, Filter):
        return f"filter, {helper._right.getSize()}"
    return "multigrid"


def memory() -> list[float]:
    """The largest memory of each rank so far, in GB."""
    kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found: list[float] = MPI.COMM_WORLD.allgather(kilobytes / 2**20)
    return found


def case(h: Fraction, n: float, degree: int) -> Parameters:
    """The block on a regular grid."""
    element = {"discretisation__degree": 2} if degree == 2 else {}
    return block(
        3, float(h), mesh__structured=True, penalty__n=n, solver__linear="iterative", **element
    )


def main() -> None:
    """Compile the forms with a small solve, and do the large one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--h", type=Fraction, default=Fraction(1, 16), help="such as 1/40")
    parser.add_argument("--n", type=float, default=math.inf)
    parser.add_argument("--degree", type=int, choices=(1, 2), default=1)
    parser.add_argument(
        "--filter-limit", type=int, help="unknowns, as the package has it if absent"
    )
    given = parser.parse_args()
    if given.filter_limit is not None:
        FILTER_LIMIT[3, given.degree] = given.filter_limit
    solving.solve(case(Fraction(1, 3), given.n, given.degree))
    tangents = Tangents()
    if MPI.COMM_WORLD.rank == 0:
        print("| tangent | preconditioner, rows factorised | set-up s | solves s | iterations |")
        print("| --- | --- | --- | --- | --- |", flush=True)
    began = time.perf_counter()
    summary = solving.solve(case(given.h, given.n, given.degree), monitor=tangents).summary
    total, used = time.perf_counter() - began, memory()
    tangents.print_last()
    if MPI.COMM_WORLD.rank > 0:
        return
    every = [count for _, _, counts in tangents.rows for count in counts]
    print()
    print(
        f"h = {given.h}, n = {given.n:g}, degree {given.degree}, {summary['dofs']} unknowns, "
        f"{len(used)} ranks on {os.cpu_count()} cores: {summary['reason']}; "
        f"{summary['iterations']['tangents']} tangents, {sum(every)} GMRES iterations, "
        f"{max(every, default=0)} at most in a solve; solver "
        f"{tangents.seconds:.0f} s, in all {total:.0f} s; memory "
        f"{max(used):.2f} GB in a rank, {sum(used):.1f} GB in all"
    )


if __name__ == "__main__":
    main()
