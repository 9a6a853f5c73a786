"""The order in h of the error for n = .inf and a friction bound that is given: 1/2 proved, 1 seen.

    python3 demos/studies/a_priori_rate.py [--finest 64]

A block between rollers, whose top is pressed and sheared by smooth tractions, on regular grids.
The bound is 0.0005 (1 - x/2) and does not move, as in the statement of docs/problem.md.  The error
is the energy norm of the distance to the solution with quadratic elements and --finest squares
along each side.  results/a_priori_rate/table.jsonl has a row for each grid, and docs/studies.md
shows them.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import ufl
from convergence import fitted_rate, write_table
from mpi4py import MPI
from transfer import on_mesh_of

from contact_locking import StudySolution, assemble, solve_assembled
from contact_locking.arrays import FloatArray
from contact_locking.contact.coulomb import FrictionBound
from contact_locking.fem.compiled import integral
from contact_locking.laws.body import isotropic_stress, lame_from_young, strain
from contact_locking.study_file.parameters import Parameters

RESULTS = Path("results/a_priori_rate")
GRIDS = (4, 8, 16, 32)
LAME = lame_from_young(1.0, 0.3)
PROBLEM: dict[str, Any] = {
    "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02},
    "loads": {
        "displacements": [{"on": ["left", "right"], "value": [0.0, None]}],
        "tractions": [{"on": "top", "value": ["0.01*sin(pi*x)", "-0.025 - 0.01*cos(pi*x)"]}],
    },
    "contact": {"on": "bottom"},
    "friction": {"coefficient": 1.0},
}


class Given(FrictionBound):
    """Tresca's friction: ``|sigma_tau| <= 0.0005 (1 - x/2)``."""

    def evaluate(self, pressure: FloatArray, slip: FloatArray) -> FloatArray:
        return 0.0005 * (1.0 - 0.5 * self.surface.points[:, 0])


def solved(divisions: int, degree: int = 1) -> StudySolution:
    """The block on a grid of ``divisions`` squares along each side."""
    mesh = {"builder": "block", "h": 1.0 / divisions, "structured": True}
    data = PROBLEM | {"mesh": mesh, "discretisation": {"degree": degree}}
    problem = assemble(Parameters.model_validate(data), MPI.COMM_WORLD)
    for contact in problem.contacts:
        law = contact.friction
        contact.friction = Given(contact.surface, law.smoothing, law.law)
    solution = solve_assembled(problem)
    if not solution.converged:
        raise SystemExit(f"h = 1/{divisions}: {solution.summary['reason']}")
    return solution


def error(solution: StudySolution, reference: StudySolution) -> float:
    """``sqrt(a(u_h - u, u_h - u))``; collective."""
    apart = on_mesh_of(solution.displacement, reference.displacement)
    apart.x.array[:] -= reference.displacement.x.array
    stress = isotropic_stress(strain(apart), *LAME)
    dx = ufl.Measure("dx", domain=reference.domain.mesh)
    return math.sqrt(integral(reference.domain, ufl.inner(stress, strain(apart)) * dx))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--finest", type=int, default=64, help="squares along each side")
    reference = solved(parser.parse_args().finest, degree=2)
    rows: list[dict[str, Any]] = []
    for divisions in GRIDS:
        solution = solved(divisions)
        found = error(solution, reference)
        shares = {key: solution.summary[key] for key in ("locked_fraction", "slip_area")}
        rows.append({"h": 1.0 / divisions, "error": found, **shares})
        if MPI.COMM_WORLD.rank == 0:
            print("  ".join(f"{key} {value:.4g}" for key, value in rows[-1].items()))
    if MPI.COMM_WORLD.rank == 0:
        rate = fitted_rate([row["h"] for row in rows], [row["error"] for row in rows])
        print(f"order {rate:.2f}")
        write_table(RESULTS, rows)
        print(f"table in {RESULTS}")


if __name__ == "__main__":
    main()
