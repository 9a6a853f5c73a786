"""The time of pairing two sides beside the solve, for docs/benchmarks.md.

    ./in-env python3 benchmarks/pairing.py    a minute

Two blocks with unmatched meshes, friction and a limit of the strain.  Times are CPU seconds of this
process on one rank: of the surface of Gamma_C with its pairing, less that of the surface alone, and
of the solve alone; nothing is timed before the forms are compiled.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from mpi4py import MPI
from stopwatch import Stopwatch

from contact_locking.contact.paired_surface import PairedSurface
from contact_locking.contact.surface import ContactSurface
from contact_locking.running.assembly import assemble
from contact_locking.running.solving import solve

# The blocks belong to the tests.
sys.path.append(str(Path(__file__).resolve().parent.parent / "tests/support"))
from two_bodies import stack

_SIZES = {2: (0.1, 0.03), 3: (0.3, 0.17)}


def measured(dim: int, h: float) -> str:
    """A row of the table."""
    given = stack(dim, h, friction__coefficient=0.3, material__locking_limit=0.006)
    problem = assemble(given, MPI.COMM_WORLD)
    body, (contact,) = problem.body, problem.contacts
    began = time.process_time()
    ContactSurface(body.domain, body.space, contact.on, element=body.element)
    alone = time.process_time() - began
    PairedSurface(body.domain, body.space, contact.concept, body.element)
    paired = time.process_time() - began - 2.0 * alone
    clock = Stopwatch()
    solution = solve(given, monitor=clock)
    assert solution.converged, solution.summary["reason"]
    share = paired / clock.seconds
    size = solution.summary["dofs"]
    return f"| {dim}D, h = {h:g} | {size} | {paired:.3f} | {clock.seconds:.2f} | {share:.1%} |"


def main() -> None:
    """Print the table."""
    for dim in _SIZES:
        measured(dim, 0.5)
    print("| blocks | unknowns | pairing s | solve s | share |\n| --- | --- | --- | --- | --- |")
    for dim, sizes in _SIZES.items():
        for h in sizes:
            print(measured(dim, h), flush=True)


if __name__ == "__main__":
    main()
