"""A square and a cube with quadratic displacements, each of which is solved once."""

from __future__ import annotations

import functools
from typing import Any

from mpi4py import MPI
from problems import solved, with_changes
from test_elements import LIMIT, benchmark

from contact_locking.results.solution import StudySolution
from contact_locking.study_file.parameters import Parameters


def quadratic(divisions: int, **changes: Any) -> Parameters:
    return benchmark(divisions, discretisation__degree=2, **changes)


def cube(**changes: Any) -> Parameters:
    """A cube without contact, clamped below and sheared, which locks in a part."""
    loads = {
        "tractions": [{"on": "top", "value": [-0.03, 0.01, -0.02]}],
        "displacements": [{"on": "bottom", "value": [0.0, 0.0, 0.0]}],
    }
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "dim": 3, "h": 0.5, "structured": True},
        "discretisation": {"degree": 2},
        "material": {"locking_limit": LIMIT},
        "loads": loads,
        "contact": {"on": []},
    }
    return with_changes(data, **changes)


@functools.cache
def square() -> StudySolution:
    return solved(quadratic(4), MPI.COMM_WORLD)


@functools.cache
def solved_cube() -> StudySolution:
    return solved(cube(), MPI.COMM_WORLD)
