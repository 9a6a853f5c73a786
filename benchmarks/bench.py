"""How many tangents, and how long beside one linear elastic solve and beside Clarabel: results.md.

    make bench                                                           some minutes
    ./in-env python3 benchmarks/bench.py --finest 256 --large --ranks    half an hour
    ./in-env python3 benchmarks/bench.py --huge                          hours, 16 GB

The case is the unit block of the tests on a regular grid, mu = 0.3, R a convolution over r = 0.1.
Everything that is compared is measured in one run, and nothing is timed before its forms are
compiled.  Times are CPU seconds of this process, one rank and one thread, which other work on the
machine disturbs less than it does the clock.
"""

from __future__ import annotations

import argparse
import datetime
import math
import os
import platform
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import dolfinx

from contact_locking.files import write_text

# The conic solver's form of the reference problem belongs to the tests.
sys.path += [
    str(Path(__file__).resolve().parent.parent / name) for name in ("tests", "tests/support")
]
from ranked import on_ranks
from sweep.reference import of_solution
from timed_block import Run, elastic_seconds, run, say, warmed_up

PENALTIES = (1e2, 1e4, 1e6, 1e8, math.inf)
RESULTS = Path(__file__).resolve().parent / "results.md"


def tangents(grids: Sequence[int]) -> tuple[list[str], list[Run]]:
    """The table of tangents over meshes and penalties, and the runs on the finest mesh."""
    runs = {(r.divisions, r.n): r for size in grids for r in warmed_up(2, size, PENALTIES)}
    rows = [[f"1/{size}", *(runs[size, n].tangents for n in PENALTIES)] for size in grids]

    def ratio(n: float) -> float:
        counts = [
            runs[size, n].solution.summary["iterations"]["tangents"]
            for size in (grids[0], grids[-1])
        ]
        return counts[1] / counts[0]

    rows.append(["last over first", *(f"{ratio(n):.2f}" for n in PENALTIES)])
    header = ["h", *(f"n = {n:g}" for n in PENALTIES)]
    return table(header, rows), [runs[grids[-1], n] for n in PENALTIES]


def over_elastic(runs: Sequence[Run]) -> list[list[str]]:
    """Rows of the times of runs of one mesh over that of an elastic solve."""
    first = runs[0].solution
    elastic = elastic_seconds(first.domain.dim, runs[0].divisions)
    return [
        [
            f"{first.domain.dim}D, 1/{r.divisions}",
            str(first.summary["dofs"]),
            f"{r.n:g}",
            r.tangents,
            f"{elastic:.3f}",
            f"{r.seconds:.2f}",
            f"{r.seconds / elastic:.1f}",
            f"{r.total:.2f}",
            f"{r.total / elastic:.1f}",
        ]
        for r in runs
    ]


def against_clarabel(mine: Run) -> list[list[str]]:
    """Rows: the same discrete problem with the bound frozen where the run left it.

    By Clarabel's own factorisation, and by the one it takes where both are there.
    """
    reference = of_solution(mine.solution)
    ours, rows = reference.energy(mine.solution.displacement.x.array), []
    for factorisation in ("qdldl", "faer"):
        solver = reference.solver(max_threads=1, direct_solve_method=factorisation)
        began = time.process_time()
        solution = solver.solve()
        seconds = time.process_time() - began
        ended = "" if str(solution.status) == "Solved" else f", {solution.status}"
        say(f"Clarabel, {factorisation}: {solution.status}, {seconds:.2f} s")
        least = reference.energy(reference.displacement(solution.x))
        rows.append(
            [
                f"{mine.solution.domain.dim}D, 1/{mine.divisions}",
                str(mine.solution.summary["dofs"]),
                f"{factorisation}{ended}",
                f"{seconds:.2f} ({solution.iterations})",
                f"{mine.seconds:.2f} ({mine.tangents})",
                f"{seconds / mine.seconds:.1f}",
                f"{mine.total:.2f}",
                f"{seconds / mine.total:.1f}",
                f"{abs(ours / least - 1.0):.0e}",
            ]
        )
    return rows


def speed_up(dim: int, divisions: int, n: float, linear: str) -> list[str]:
    """A row: one case on one rank and on two, by the clock."""
    one, two = (on_ranks(ranks, dim, divisions, n, linear) for ranks in (1, 2))
    differ = abs(two["compliance"] / one["compliance"] - 1.0)
    say(f"{dim}D, 1/{divisions}, {linear}: {one['seconds']:.1f} s and {two['seconds']:.1f} s")
    return [
        f"{dim}D, 1/{divisions}, {linear}",
        str(one["dofs"]),
        f"{n:g}",
        *(f"{r['seconds']:.1f} ({r['iterations']['tangents']})" for r in (one, two)),
        f"{one['seconds'] / two['seconds']:.2f}",
        f"{differ:.0e}",
    ]


def huge() -> list[str]:
    """A row: 3D with 800 k dofs on two ranks."""
    case = on_ranks(2, 3, 64, 1e4, "iterative")
    iterations = case["iterations"]
    return [
        "3D, 1/64, iterative",
        str(case["dofs"]),
        "10000",
        f"{iterations['tangents']}",
        f"{iterations['linear']}",
        f"{case['seconds']:.0f}",
        f"{case['gigabytes']:.1f}",
        case["reason"],
    ]


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """In Markdown, the columns lined up."""
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    lines = [header, ["-" * width for width in widths], *rows]
    return ["| " + " | ".join(map(str.ljust, line, widths)) + " |" for line in lines]


def machine() -> str:
    """What it was measured on, and when."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text().splitlines()
        cpu = next((line.split(": ")[1] for line in lines if line.startswith("model name")), cpu)
    # Where it is set, OpenBLAS may not use all that the processor has.
    kernels = os.environ.get("OPENBLAS_CORETYPE")
    return (
        f"{cpu}, {os.cpu_count()} cores, one rank and one thread; DOLFINx {dolfinx.__version__}; "
        + (f"OPENBLAS_CORETYPE={kernels}; " if kernels else "")
        + f"{datetime.date.today():%d %B %Y}."
    )


def main() -> None:
    """Measure, write results.md and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--finest", type=int, default=128, help="1/h of the finest mesh in 2D")
    parser.add_argument("--large", action="store_true", help="also 3D with 100 k dofs")
    parser.add_argument("--ranks", action="store_true", help="also two ranks against one")
    parser.add_argument("--huge", action="store_true", help="also 3D with 800 k dofs on two ranks")
    given = parser.parse_args()
    grids = [size for size in (32, 64, 128, 256) if size <= given.finest]
    for dim in (2, 3):
        run(dim, 4, math.inf)  # compiles the forms
        run(dim, 4, 1e2)
    counts, planar = tangents(grids)
    solid = warmed_up(3, 16, (1e4, math.inf))
    times = over_elastic(planar) + over_elastic(solid)
    if given.large:
        times += over_elastic(warmed_up(3, 32, (1e4, math.inf)))
    judged = [run(2, size, math.inf) for size in grids if size >= 128] + [solid[-1]]
    conic = [row for mine in judged for row in against_clarabel(mine)]
    parallel = []
    if given.ranks:
        parallel.append(speed_up(2, 256, math.inf, "direct"))
        parallel += [speed_up(3, 32, n, "iterative") for n in (1e4, math.inf)]
    columns = ["block", "dofs", "n", "tangents", "elastic s"]
    columns += ["solver s", "/ elastic", "in all s", "/ elastic"]
    against = ["block", "dofs", "Clarabel", "s (iterations)", "solver s (tangents)", "faster"]
    against += ["in all s", "faster", "energies differ by"]
    text = [
        "# Measured by `make bench`",
        "",
        machine(),
        "",
        "The unit block of the tests, E = 1, nu = 0.3, M = 0.02, mu = 0.3, R a convolution over",
        "r = 0.1, eps = 1/n, on a regular grid. Struck out: not converged.",
        "",
        "## Tangents in 2D",
        "",
        *counts,
        "",
        "## Times beside a linear elastic solve",
        "",
        "An elastic solve is assembly, factorisation (or set-up) and solution with the same linear",
        "solver. The solver's time is that of the nonlinear solve alone; the time in all adds the",
        "mesh, the problem and the fields and bounds derived from its solution. CPU seconds.",
        "",
        *table(columns, times),
        "",
        "## Times beside Clarabel, n = inf",
        "",
        "The same discrete problem with the friction bound frozen, at Clarabel's own tolerances;",
        "setting up its matrices is not counted. CPU seconds.",
        "",
        *table(against, conic),
        "",
    ]
    if parallel:
        header = ["block", "dofs", "n", "1 rank s (tangents)", "2 ranks s (tangents)"]
        header += ["faster", "compliances differ by"]
        text += ["## Two ranks against one", "", "By the clock.", "", *table(header, parallel), ""]
    if given.huge:
        header = ["block", "dofs", "n", "tangents", "CG iterations", "solver s", "GB", "end"]
        text += ["## The largest case, on two ranks", "", *table(header, [huge()]), ""]
    write_text(RESULTS, "\n".join(text))
    print("\n".join(text))


if __name__ == "__main__":
    main()
