"""Compare the estimate that `check` prints with what a solve takes: docs/guides/large.md.

    ./in-env python3 benchmarks/estimates.py           a table of demos, some refined: two minutes
    ./in-env python3 benchmarks/estimates.py hertz     of the demos whose names begin so

Each solve has a process of its own.  Times are CPU seconds on one rank, without pictures, and
memory is the largest of the process.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

DEMOS = Path(__file__).resolve().parent.parent / "demos"
# A demo, what is changed, and in words what the row is about.
CASES = (
    ("hertz", "mesh.h=0.2 mesh.h_contact=0.008", "2D, elastic"),
    ("block", "mesh.h=0.008", "2D, n = 1e4"),
    ("block", "mesh.h=0.02 penalty.n=.inf discretisation.degree=2", "2D, degree 2, n = ∞"),
    ("block", "solver.method=newton", "2D, Newton's method"),
    ("anisotropic_regions", "mesh.h=0.01", "2D, two materials"),
    ("notch", "mesh.h=0.02 mesh.h_contact=0.005", "2D, no contact"),
    ("ssnv128", "mesh.h=5e-4", "2D, a corner that slips"),
    ("slip_friction", "", "2D, nested friction"),
    ("two_foundations", "mesh.h=0.015", "2D, two contacts"),
    ("cyclic_slip", "", "2D, 42 steps"),
    ("gripper", "mesh.h=0.03", "2D, 8 steps, pushed by forces"),
    ("indentation", "", "axisymmetric, 10 steps"),
    ("indentation", "mesh.h=0.01 steps.count=5", "axisymmetric, 5 steps"),
    ("block_3d", "", "3D, n = 1e4"),
    ("block_3d", "mesh.h=0.05 penalty.n=.inf", "3D, n = ∞"),
    ("block_3d", "mesh.h=0.14 discretisation.degree=2", "3D, degree 2"),
    ("block_3d", "mesh.h=0.06 solver.linear=iterative", "3D, CG"),
    ("ball_3d", "mesh.h_contact=0.02", "3D, elastic"),
    ("pressed_tool", "steps.count=6", "3D, 6 steps, a tool"),
)


def solve(file: Path, changes: list[str]) -> dict[str, Any]:
    """Estimate and solve a study file in this process."""
    from mpi4py import MPI

    from contact_locking import check, load, solve
    from contact_locking.running import run_steps

    parameters = load(file, [*changes, "output.picture=false"]).parameters
    facts = check(parameters, MPI.COMM_WORLD)
    began = time.process_time()
    if parameters.steps is None:
        summary = solve(parameters).summary
    else:
        with tempfile.TemporaryDirectory() as folder:
            summary = run_steps(parameters, folder)[0].summary
    assert summary["converged"], summary["reason"]
    return {
        "unknowns": facts["dofs"],
        "estimate": (facts["estimate"].seconds, facts["estimate"].memory / 1e9),
        "seconds": time.process_time() - began,
        "gigabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
        "tangents": summary.get("steps", summary["iterations"])["tangents"],
    }


def main(wanted: str) -> None:
    """Print a row for each case."""
    print(
        "| problem | unknowns | tangents | time: estimate, measured | memory: estimate, measured |"
    )
    print("| --- | --- | --- | --- | --- |")
    for name, changes, words in CASES:
        if not name.startswith(wanted):
            continue
        command = [sys.executable, __file__, "--solve", str(DEMOS / f"{name}.yml")]
        done = subprocess.run(
            [*command, *changes.split()], stdout=subprocess.PIPE, text=True, check=True
        )
        row = json.loads(done.stdout.splitlines()[-1])
        seconds, gigabytes = row["estimate"]
        print(
            f"| {name}, {words} | {row['unknowns']} | {row['tangents']} "
            f"| {seconds:.1f}, {row['seconds']:.1f} s ({seconds / row['seconds']:.1f}) "
            f"| {gigabytes:.2f}, {row['gigabytes']:.2f} GB |",
            flush=True,
        )


if __name__ == "__main__":
    if sys.argv[1:2] == ["--solve"]:
        print(json.dumps(solve(Path(sys.argv[2]), sys.argv[3:])))
    else:
        main(sys.argv[1] if len(sys.argv) > 1 else "")
