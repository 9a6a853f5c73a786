"""Solve one case of the block on every rank of mpirun, and print what it took as JSON.

./in-env mpirun -n 2 python3 benchmarks/ranked.py 3 32 1e4 iterative
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent


def on_ranks(ranks: int, dim: int, divisions: int, n: float, linear: str) -> dict[str, Any]:
    """The same as a dictionary, from ``mpirun -n ranks`` in a process of its own."""
    case = [str(dim), str(divisions), str(n), linear]
    command = ["mpirun", "-n", str(ranks), sys.executable, str(HERE / "ranked.py"), *case]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def main() -> None:
    """Solve twice in small, for the forms, and once as asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dim", type=int)
    parser.add_argument("divisions", type=int)
    parser.add_argument("n", type=float)
    parser.add_argument("linear", choices=["direct", "iterative"])
    given = parser.parse_args()

    sys.path.append(str(HERE.parent / "tests/support"))
    from mpi4py import MPI
    from problems import block
    from stopwatch import WallClock

    from contact_locking.running import solving
    from contact_locking.solver.monitor import Monitor

    def solve(divisions: int, monitor: Monitor) -> Any:
        h = 1.0 / divisions
        changes = {"penalty__n": given.n, "solver__linear": given.linear}
        return solving.solve(block(given.dim, h, mesh__structured=True, **changes), monitor=monitor)

    solve(4, Monitor())
    clock = WallClock()
    summary = solve(given.divisions, clock).summary
    kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    memory = MPI.COMM_WORLD.allreduce(kilobytes)
    if MPI.COMM_WORLD.rank == 0:
        kept = ("dofs", "converged", "reason", "iterations", "compliance", "elastic_energy")
        result = {key: summary[key] for key in kept}
        result |= {"seconds": clock.seconds, "gigabytes": memory / 2**20}
        print(json.dumps(result))


if __name__ == "__main__":
    main()
