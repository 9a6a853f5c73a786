"""A square and a cube with quadratic displacements, each of which is solved once."""

from __future__ import annotations

import functools
from typing import Any

import pytest
from mpi4py import MPI
from problems import with_changes
from test_elements import LIMIT, benchmark

from contact_locking.process import solving
from contact_locking.results.solution import StudySolution
from contact_locking.study_file.parameters import Parameters

POINTS = pytest.mark.parametrize("limit_at", ["vertices", "gauss"])
GAUSS = {"degree": 2, "limit_at": "gauss"}


def quadratic(divisions: int, limit_at: str = "gauss", **changes: Any) -> Parameters:
    given = {"discretisation__degree": 2, "discretisation__limit_at": limit_at}
    return benchmark(divisions, **given, **changes)


def cube(limit_at: str = "gauss", **changes: Any) -> Parameters:
    """A cube without contact, clamped below and sheared, which locks in a part."""
    loads = {
        "tractions": [{"on": "top", "value": [-0.03, 0.01, -0.02]}],
        "displacements": [{"on": "bottom", "value": [0.0, 0.0, 0.0]}],
    }
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "dim": 3, "h": 0.5, "structured": True},
        "discretisation": {"degree": 2, "limit_at": limit_at},
        "material": {"locking_limit": LIMIT},
        "loads": loads,
        "contact": {"on": []},
    }
    return with_changes(data, **changes)


def solved(parameters: Parameters, comm: MPI.Intracomm) -> StudySolution:
    solution = solving.solve(parameters, comm)
    assert solution.converged, solution.summary["reason"]
    return solution


@functools.cache
def square(limit_at: str) -> StudySolution:
    return solved(quadratic(4, limit_at), MPI.COMM_WORLD)


@functools.cache
def solved_cube() -> StudySolution:
    return solved(cube(), MPI.COMM_WORLD)
