"""Solves for several tests of the certificate."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

from contact_locking import solving
from contact_locking.parameters import Parameters
from contact_locking.results.solution import Solution


def solved(parameters: Parameters, comm: MPI.Intracomm = MPI.COMM_WORLD) -> Solution:
    solution = solving.solve(parameters, comm)
    assert solution.converged, solution.summary["reason"]
    return solution


def certificate(parameters: Parameters, comm: MPI.Intracomm = MPI.COMM_WORLD) -> dict[str, Any]:
    return dict(solved(parameters, comm).summary["certificate"])
