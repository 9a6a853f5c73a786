"""Theorem 4.10 and the rates in h: meshes and penalties refined together, h = C n^-s.

    python3 demos/studies/theorem_4_10.py [--finest 512]

The block of theorem_4_9.yml on nested regular grids with eps = 1/n.  n = 100 on the coarsest grid
and grows as h = C n^-s asks for, so all couplings start from the same solution.  Two more follow h
alone: n = .inf, and the contact penalty of Chouly and Hild, eps in proportion to h.  The reference
is the solution of the inequality, n = .inf, on a grid of its own, as fine as --finest says; the
grids are nested, so that the distances are exact.  The method of the paper solves for a finite n
with eps = 1/n, and the general solver for the others.  results/theorem_4_10/table.jsonl has a row
for each solve, and docs/studies.md shows them.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import time
from pathlib import Path
from typing import Any

from convergence import distance, fitted_rate, norms, write_table
from mpi4py import MPI

from contact_locking import StudySolution, load, solve

FILE = Path(__file__).with_name("theorem_4_9.yml")
RESULTS = Path("results/theorem_4_10")
DIVISIONS = (8, 16, 32, 64, 128)
FIRST_N = 100.0
EXPONENTS = (0.5, 1.0, 1.5, 2.0)
# Rates are fitted to the finer grids, where the error has settled.
FITTED = 3


def solved(divisions: int, n: float, epsilon: float | None = None) -> StudySolution:
    """The block on a grid of ``divisions`` squares along each side."""
    changes = [f"mesh.h={1.0 / divisions!r}", f"penalty.n={_yaml(n)}", "certificate.limit=false"]
    changes += [f"solver.method={'penalty' if n < math.inf else 'auto'}"]
    changes += [] if epsilon is None else [f"penalty.epsilon={epsilon!r}"]
    solution = solve(load(FILE, changes).parameters)
    if not solution.converged:
        raise SystemExit(f"h = 1/{divisions}, n = {n:g}: {solution.summary['reason']}")
    return solution


def couplings() -> dict[str, list[tuple[float, float | None]]]:
    """n and eps for each grid."""
    growth = [divisions / DIVISIONS[0] for divisions in DIVISIONS]
    found: dict[str, list[tuple[float, float | None]]] = {
        f"h = C n^-{s:g}": [(FIRST_N * g ** (1.0 / s), None) for g in growth] for s in EXPONENTS
    }
    found["n = inf"] = [(math.inf, None) for _ in growth]
    found["n = inf, eps = C h"] = [(math.inf, 1.0 / (FIRST_N * g)) for g in growth]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--finest", type=int, default=512, help="divisions of the reference")
    finest = parser.parse_args().finest
    if finest % DIVISIONS[-1]:
        parser.error(f"--finest must be a multiple of {DIVISIONS[-1]}, to nest the grids")
    began = time.perf_counter()
    reference = solved(finest, math.inf)
    size = norms(reference.displacement, reference.domain, reference.parameters.contact_names)
    rows: list[dict[str, Any]] = []
    for coupling, penalties in couplings().items():
        in_v = []
        for divisions, (n, epsilon) in zip(DIVISIONS, penalties, strict=True):
            error = distance(solved(divisions, n, epsilon), reference)
            row = {"coupling": coupling, "h": 1.0 / divisions, "n": n if n < math.inf else "inf"}
            row |= {"error": dataclasses.asdict(error)}
            row |= {"relative": dataclasses.asdict(error.over(size))}
            rows.append(row)
            in_v.append(error.v)
        rate = fitted_rate([1.0 / d for d in DIVISIONS[-FITTED:]], in_v[-FITTED:])
        if MPI.COMM_WORLD.rank == 0:
            print(f"{coupling:20}  rate in h {rate:.2f}", flush=True)
    if MPI.COMM_WORLD.rank == 0:
        write_table(RESULTS, rows)
        print(f"{time.perf_counter() - began:.0f} s, table in {RESULTS}")


def _yaml(n: float) -> str:
    return ".inf" if n == math.inf else repr(n)


if __name__ == "__main__":
    main()
