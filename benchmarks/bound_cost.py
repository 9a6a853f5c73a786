"""The time of the guaranteed error bound beside one linear elastic solve, for docs/notes/bounds.md.

    ./in-env python3 benchmarks/bound_cost.py    a minute

The case is the unit block of the tests on a regular grid, mu = 0.3, M = 0.05 and n = inf.  Times
are CPU seconds of this process on one rank, the least of five; nothing is timed before its forms
are compiled.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

from contact_locking.certificate.penalty_error import EllipticProblem, Lifting
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.running.assembly import assemble
from contact_locking.running.solving import SolvableStudy
from contact_locking.study_file.parameters import Parameters
from contact_locking.theory.energy_bound import guaranteed_error

# The reference problem belongs to the tests.
sys.path.append(str(Path(__file__).resolve().parent.parent / "tests/support"))
from problems import block


def case(divisions: int) -> Parameters:
    """The block on a regular grid, with a guaranteed bound."""
    loads = {
        "tractions": [{"on": "top", "value": [-0.03, -0.05]}],
        "displacements": [{"on": "right", "value": [0.0, 0.0]}],
    }
    return block(
        2,
        1.0 / divisions,
        mesh__structured=True,
        material__locking_limit=0.05,
        penalty__n=math.inf,
        loads=loads,
        certificate__error_bound=True,
    )


def solved_state(divisions: int) -> SolvedState:
    """The state at the end of a solve, from which the bound is computed."""
    solve = SolvableStudy(assemble(case(divisions), MPI.COMM_WORLD)).solver
    return solve.state(solve.solve())


def elastic_solve(state: SolvedState) -> None:
    """Assembly, factorisation and solution of linear elasticity on the mesh of the state."""
    bilinear, constraints = state.system.bilinear, state.problem.constraints
    with closing(EllipticProblem(state, bilinear, constraints)) as solver:
        solver.solve(state.system.forms.loads())


def least_seconds(work: Callable[[], Any], repeats: int = 5) -> float:
    """The least CPU time of the work."""

    def once() -> float:
        start = time.process_time()
        work()
        return time.process_time() - start

    return min(once() for _ in range(repeats))


def main() -> None:
    """Print a row for each mesh."""
    print("squares a side   elastic s   bound s   bound / elastic")
    for divisions in (32, 64, 128):
        state = solved_state(divisions)
        elastic = least_seconds(partial(elastic_solve, state))
        bound = least_seconds(partial(guaranteed_error, state, Lifting(state)))
        print(f"{divisions:14d} {elastic:11.3f} {bound:9.3f} {bound / elastic:17.1f}", flush=True)


if __name__ == "__main__":
    main()
