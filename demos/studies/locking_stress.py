"""What the locking stress Z does as the mesh is refined: its norms in L1 and L2, and its peak.

    python3 demos/studies/locking_stress.py [--finest 256]

The block of theorem_4_9.yml on regular grids, n = .inf.  results/locking_stress/table.jsonl has a
row for each grid, and docs/studies.md shows them.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from convergence import fitted_rate, write_table
from dolfinx import mesh as dmesh
from mpi4py import MPI

from contact_locking import StudySolution, load, solve
from contact_locking.fem.compiled import integral

FILE = Path(__file__).with_name("theorem_4_9.yml")
RESULTS = Path("results/locking_stress")
COARSEST = 8


def solved(divisions: int) -> StudySolution:
    """The block on a grid of ``divisions`` squares along each side."""
    changes = [f"mesh.h={1.0 / divisions!r}", "penalty.n=.inf", "certificate.limit=false"]
    changes.append("solver.method=auto")
    solution = solve(load(FILE, changes).parameters)
    if not solution.converged:
        raise SystemExit(f"h = 1/{divisions}: {solution.summary['reason']}")
    return solution


def norms(solution: StudySolution) -> dict[str, Any]:
    """``int |Z|``, ``int |Z|^2``, ``max |Z|`` and the midpoint of the cell where that is."""
    domain, stress = solution.domain, solution.locking_stress
    size = ufl.sqrt(ufl.inner(stress, stress))
    dx = ufl.Measure("dx", domain=domain.mesh)
    dofs = stress.function_space.dofmap
    owned = domain.mesh.topology.index_map(domain.dim).size_local
    tensors = stress.x.array.reshape(-1, domain.dim**2)[dofs.list.reshape(-1)[:owned]]
    sizes = np.linalg.norm(tensors, axis=1)
    cells = np.array([np.argmax(sizes)] if owned else [], dtype=np.int32)
    place = dmesh.compute_midpoints(domain.mesh, domain.dim, cells)[:, : domain.dim]
    peaks = domain.comm.allgather((float(sizes.max(initial=0.0)), place.reshape(-1).tolist()))
    return {
        "h": solution.parameters.mesh.geometry.h,
        "l1": integral(domain, size * dx),
        "l2_squared": integral(domain, size**2 * dx),
        "max": max(peaks)[0],
        "at": max(peaks)[1],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--finest", type=int, default=256, help="squares along each side")
    finest = parser.parse_args().finest
    divisions = [COARSEST * 2**k for k in range(int(math.log2(max(finest // COARSEST, 1))) + 1)]
    rows: list[dict[str, Any]] = []
    for count in divisions:
        rows.append(norms(solved(count)))
        if MPI.COMM_WORLD.rank == 0:
            shown = "  ".join(f"{key} {rows[-1][key]:.4g}" for key in ("l1", "l2_squared", "max"))
            print(f"h = 1/{count:<4} {shown}  at {rows[-1]['at']}", flush=True)
    if MPI.COMM_WORLD.rank == 0:
        rate = fitted_rate([row["h"] for row in rows[-3:]], [row["max"] for row in rows[-3:]])
        print(f"the peak grows like h^{rate:.2f}")
        write_table(RESULTS, rows)
        print(f"table in {RESULTS}")


if __name__ == "__main__":
    main()
