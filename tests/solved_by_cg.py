"""A locked cube, solved with a linear solver and PETSc options of choice."""

from __future__ import annotations

import pytest
from problems import block

from contact_locking import solving
from contact_locking.results.solution import Solution


def solved(n: float, linear: str, **options: str) -> Solution:
    # A regular grid and a filter of stiff cells in all parts of it.
    parameters = block(3, 1 / 6, mesh__structured=True, penalty__n=n, solver__linear=linear)
    solution = solving.solve(parameters, petsc_options=options)
    assert solution.converged, solution.summary["reason"]
    return solution


# Either stops at a duality gap of 1e-8 of the elastic energy, unless Newton polishes it.  The gap
# bounds a(e, e)/2 of the error e; energies, which are linear in e, agree to 1e-7 here.
_SAME = 2e-7


def agree(one: Solution, other: Solution) -> None:
    for key in ("compliance", "elastic_energy"):
        assert one.summary[key] == pytest.approx(other.summary[key], rel=_SAME)
