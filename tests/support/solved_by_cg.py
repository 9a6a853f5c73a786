"""Blocks for iterative solvers: a locked cube with options of choice, and one that is crushed."""

from __future__ import annotations

import math

import pytest
from problems import block

from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.study_file.parameters import Parameters


def solved(n: float, linear: str, **options: str) -> StudySolution:
    # A regular grid and a filter of stiff cells in all parts of it.
    parameters = block(3, 1 / 6, mesh__structured=True, penalty__n=n, solver__linear=linear)
    solution = solving.solve(parameters, petsc_options=options)
    assert solution.converged, solution.summary["reason"]
    return solution


def crushed_steel() -> Parameters:
    """Steel in megapascals and millimetres, of which half of what is prescribed can be followed."""
    return block(
        3,
        20.0,
        mesh__size=[100.0, 100.0, 100.0],
        material={"elasticity": {"young": 2.1e5, "poisson": 0.3}, "locking_limit": 0.01},
        friction__smoothing__radius=20.0,
        loads={"displacements": [{"on": "top", "value": [0.0, 0.0, -2.0]}]},
        penalty__n=math.inf,
        solver__linear="iterative",
    )


# Either stops at a duality gap of 1e-8 of the elastic energy, unless the pieces finish it.  The gap
# bounds a(e, e)/2 of the error e; energies, which are linear in e, agree to 1e-7 here.
_SAME = 2e-7


def agree(one: StudySolution, other: StudySolution) -> None:
    for key in ("compliance", "elastic_energy"):
        assert one.summary[key] == pytest.approx(other.summary[key], rel=_SAME)
