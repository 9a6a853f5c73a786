"""The proved bound of the error, the estimate, and the error itself from a finer mesh.

    python3 demos/studies/error_bound.py [--finest 128]

The cases of error_bound.yml.  The error is the energy norm of the distance to the solution of the
inequality with quadratic elements on a regular grid with --finest squares along each side, which
has an error of its own.
results/error_bound_measured/table.jsonl has a row for each case.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

import ufl
from convergence import write_table
from mpi4py import MPI
from transfer import on_mesh_of

from contact_locking import StudySolution, load, solve
from contact_locking.fem.compiled import integral
from contact_locking.laws.body import isotropic_stress, lame_from_young, strain

FILE = Path(__file__).with_name("error_bound.yml")
RESULTS = Path("results/error_bound_measured")
LAME = lame_from_young(1.0, 0.3)


def solved(changes: dict[str, Any]) -> StudySolution:
    """The problem of the study with some keys changed."""
    given = [
        f"{key}={'.inf' if value == math.inf else json.dumps(value)}"
        for key, value in changes.items()
    ]
    solution = solve(load(FILE, given).parameters)
    if not solution.converged:
        raise SystemExit(f"{', '.join(given)}: {solution.summary['reason']}")
    return solution


def energy_norm(u: Any, solution: StudySolution) -> float:
    """``sqrt(a(u, u))`` on the mesh of a solution; collective."""
    stress = isotropic_stress(strain(u), *LAME)
    dx = ufl.Measure("dx", domain=solution.domain.mesh)
    return math.sqrt(integral(solution.domain, ufl.inner(stress, strain(u)) * dx))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--finest", type=int, default=128, help="squares along each side")
    finest = 1.0 / parser.parse_args().finest
    study = load(FILE, []).parameters.study
    assert study is not None
    references: dict[float, StudySolution] = {}
    rows: list[dict[str, Any]] = []
    for case in study.cases():
        limit = case["material.locking_limit"]
        if limit not in references:
            finer = {"discretisation.degree": 2, "mesh.h": finest, "penalty.n": math.inf}
            references[limit] = solved(case | finer | {"certificate.error_bound": False})
        reference, solution = references[limit], solved(case)
        errors = solution.summary["certificate"]["errors"]
        apart = on_mesh_of(solution.displacement, reference.displacement)
        apart.x.array[:] -= reference.displacement.x.array
        error = energy_norm(apart, reference) / energy_norm(reference.displacement, reference)
        bound, estimate = errors["guaranteed"]["relative"], errors["mesh"]["relative"]
        names = {key: value if math.isfinite(value) else "inf" for key, value in case.items()}
        rows.append(names | {"bound": bound, "estimate": estimate, "error": error})
        if MPI.COMM_WORLD.rank == 0:
            shown = "  ".join(f"{key} {value}" for key, value in names.items())
            print(f"{shown}  bound {bound:.3g}  estimate {estimate:.3g}  error {error:.3g}")
    if MPI.COMM_WORLD.rank == 0:
        write_table(RESULTS, rows)
        print(f"table in {RESULTS}")


if __name__ == "__main__":
    main()
