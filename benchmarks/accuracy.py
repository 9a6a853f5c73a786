"""The errors of linear and quadratic elements over unknowns and time: accuracy.json and a figure.

    ./in-env python3 benchmarks/accuracy.py                 some minutes
    ./in-env python3 benchmarks/accuracy.py --figure docs/figures/error_over_time.svg

The case is the unit block of the tests on a regular grid, clamped on the right and pulled to the
left, so that the diagonals of its cells go up from the clamped side, which is the worse of both
ways; mu = 0.3, R a convolution over r = 0.1.  The errors are relative, in V, to quadratic elements
on a fine grid.  Times are CPU seconds of the nonlinear solve, one rank and one thread; nothing is
timed before its forms are compiled.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

from contact_locking.fem.spaces import P1, P2, Element
from contact_locking.files import write_text
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.running.assembly import assemble
from contact_locking.study_file.parameters import Parameters

# The reference problem belongs to the tests, the distances to the studies.
sys.path.append(str(Path(__file__).resolve().parent.parent / "tests/support"))
sys.path.append(str(Path(__file__).resolve().parent.parent / "demos/studies"))
import convergence
from problems import block
from stopwatch import Stopwatch

RESULTS = Path(__file__).resolve().parent / "accuracy.json"
PENALTIES = (math.inf, 1e4)
ELEMENTS = {"P1": P1, "P2": P2}
# The reference has its limits at other points than both, and favours neither.
_GAUSS = {"quadrature_degree": 2}
OTHER = replace(P2, locking_rule=_GAUSS, at_gauss_points=True, elastic_rule=_GAUSS)
# The cells a side, for each dimension and degree, that have about as many unknowns.
GRIDS = {(2, 1): (16, 32, 64, 96), (2, 2): (8, 16, 32, 48), (3, 1): (4, 8), (3, 2): (2, 4)}
# The cells a side of the reference.
REFERENCE = {2: 96, 3: 8}


def case(dim: int, divisions: int, n: float) -> Parameters:
    """The block on a regular grid, pulled away from the side that is clamped."""
    loads = {
        "tractions": [{"on": "top", "value": [-0.03, *[0.0] * (dim - 2), -0.05]}],
        "displacements": [{"on": "right", "value": [0.0] * dim}],
    }
    changes: dict[str, Any] = {"mesh__structured": True, "loads": loads, "penalty__n": n}
    radius = 0.1 if dim == 2 else 0.25
    return block(dim, 1.0 / divisions, friction__smoothing__radius=radius, **changes)


def solved(dim: int, divisions: int, n: float, element: Element) -> tuple[StudySolution, float]:
    """The solution, and the seconds of its nonlinear solve."""
    watch = Stopwatch()
    problem = assemble(case(dim, divisions, n), MPI.COMM_WORLD, element=element)
    solution = solving.solve_assembled(problem, monitor=watch)
    if not solution.converged:
        raise RuntimeError(f"{dim}D, 1/{divisions}, n = {n:g}: {solution.summary['reason']}")
    print(f"{dim}D, 1/{divisions}, n = {n:g}, {element}: {watch.seconds:.2f} s", file=sys.stderr)
    return solution, watch.seconds


def measured(dim: int, n: float) -> list[dict[str, Any]]:
    """The rows of one dimension and penalty."""
    reference, _ = solved(dim, REFERENCE[dim], n, OTHER)
    size = convergence.norms(reference.displacement, reference.domain).v
    rows = []
    for name, element in ELEMENTS.items():
        solved(dim, GRIDS[dim, element.degree][0], n, element)
        for divisions in GRIDS[dim, element.degree]:
            solution, seconds = solved(dim, divisions, n, element)
            rows.append(
                {
                    "dim": dim,
                    "n": str(n),
                    "element": name,
                    "divisions": divisions,
                    "dofs": solution.summary["dofs"],
                    "error": convergence.distance(solution, reference).v / size,
                    "compliance": solution.summary["compliance"],
                    "tangents": solution.summary["iterations"]["tangents"],
                    "seconds": seconds,
                }
            )
            print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    return rows


def table(rows: Sequence[dict[str, Any]]) -> list[str]:
    """The rows in Markdown."""
    lines = ["| block | n | element | dofs | error in V | compliance | tangents | solver s |"]
    lines.append("| --- " * 8 + "|")
    for row in rows:
        lines.append(
            f"| {row['dim']}D, 1/{row['divisions']} | {row['n']} | {row['element']} | "
            f"{row['dofs']} | {row['error']:.4f} | {row['compliance']:.3e} | {row['tangents']} | "
            f"{row['seconds']:.2f} |"
        )
    return lines


def draw(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Draw the errors over the unknowns and over the time of the solver, for n = inf in 2D."""
    from rates import Curve, Panel, rate_plot

    def panel(title: str, key: str, label: str) -> Panel:
        curves = []
        for name in ELEMENTS:
            chosen = [
                row
                for row in rows
                if (row["dim"], row["n"], row["element"]) == (2, str(math.inf), name)
            ]
            curves.append(
                Curve(name, [row[key] for row in chosen], [row["error"] for row in chosen])
            )
        return Panel(title, label, "relative error in V", curves)

    panels = [
        panel("Error over size", "dofs", "unknowns"),
        panel("Error over time", "seconds", "CPU seconds of the solver"),
    ]
    rate_plot(panels, path)


def main() -> None:
    """Measure and write accuracy.json, or draw what it holds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figure", type=Path, help="draw accuracy.json into this file")
    parser.add_argument("--dim", type=int, choices=(2, 3), help="only this dimension")
    given = parser.parse_args()
    rows = json.loads(RESULTS.read_text("utf-8")) if RESULTS.exists() else []
    if given.figure is not None:
        draw(rows, given.figure)
        return
    for dim in (2, 3) if given.dim is None else (given.dim,):
        for n in PENALTIES:
            rows = [row for row in rows if (row["dim"], row["n"]) != (dim, str(n))]
            rows += measured(dim, n)
            write_text(RESULTS, json.dumps(rows, indent=1) + "\n")
    print("\n".join(table(rows)))


if __name__ == "__main__":
    main()
