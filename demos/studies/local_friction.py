"""From non-local to local Coulomb friction: u_r for smaller and smaller radii of R.

    python3 demos/studies/local_friction.py [--divisions 128]

The block of theorem_4_9.yml, n = .inf, all on one mesh: the distance of u_r, with the friction
bound mu |R sigma_nu|, to u_0 with mu |sigma_nu|, for both kernels of R; the Helmholtz filter has
the radius that makes it as wide as a hat of radius r.  results/local_friction/table.jsonl has a
row for each, and docs/studies.md shows them.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from pathlib import Path
from typing import Any

from convergence import distance, fitted_rate, norms, write_table
from mpi4py import MPI

from contact_locking import StudySolution, assemble, load, solve_assembled
from contact_locking.mesh.domain import Domain

FILE = Path(__file__).with_name("theorem_4_9.yml")
RESULTS = Path("results/local_friction")
RADII = (0.4, 0.2, 0.1, 0.05, 0.025)


def solved(divisions: int, smoothing: str, domain: Domain | None = None) -> StudySolution:
    """The block on a grid, or on a mesh that there is already."""
    changes = [f"mesh.h={1.0 / divisions!r}", "penalty.n=.inf", f"friction.smoothing={smoothing}"]
    changes.append("solver.method=auto")
    parameters = load(FILE, changes).parameters
    solution = solve_assembled(assemble(parameters, MPI.COMM_WORLD, domain))
    if not solution.converged:
        raise SystemExit(f"{smoothing}: {solution.summary['reason']}")
    return solution


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--divisions", type=int, default=128, help="squares along each side")
    divisions = parser.parse_args().divisions
    local = solved(divisions, "{kernel: none}")
    size = norms(local.displacement, local.domain, local.parameters.contact_names)
    rows: list[dict[str, Any]] = []
    for kernel, width in (("convolution", 1.0), ("helmholtz", 0.5 / math.sqrt(3.0))):
        errors = []
        for radius in RADII:
            smoothing = f"{{kernel: {kernel}, radius: {width * radius!r}}}"
            error = distance(solved(divisions, smoothing, local.domain), local)
            errors.append(error.v)
            row = {"kernel": kernel, "r": radius, "error": dataclasses.asdict(error)}
            rows.append({**row, "relative": dataclasses.asdict(error.over(size))})
        if MPI.COMM_WORLD.rank == 0:
            print(f"{kernel:12}  rate in r {fitted_rate(RADII, errors):.2f}", flush=True)
    if MPI.COMM_WORLD.rank == 0:
        write_table(RESULTS, rows)
        print(f"table in {RESULTS}")


if __name__ == "__main__":
    main()
