"""A block on oblique rollers, which is the turned block on its rollers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from mpi4py import MPI
from problems import block

from contact_locking.arrays import FloatArray
from contact_locking.results.solution import StudySolution
from contact_locking.running.assembly import StudyProblem, assemble, mesh_of
from contact_locking.running.solving import solve_assembled
from contact_locking.study_file.parameters import Parameters

# The displacement into the body that the rollers prescribe.
MOVED = 0.002
SIDES = ("left", "top")


def turn(dim: int) -> FloatArray:
    """A rotation that moves every axis."""
    cosine, sine = math.cos(0.4), math.sin(0.4)
    plane = np.array([[cosine, -sine], [sine, cosine]])
    if dim == 2:
        return plane
    about_z, about_x = np.eye(3), np.eye(3)
    about_z[:2, :2] = about_x[1:, 1:] = plane
    return about_x @ about_z


def vector(values: FloatArray) -> list[float]:
    return [float(value) for value in values]


def holds(solution: StudySolution) -> bool:
    """Whether every criterion of the certificate holds."""
    criteria = solution.summary["certificate"]["criteria"]
    return all(criterion["holds"] for criterion in criteria.values())


def rollers(dim: int, rotation: FloatArray, along: str) -> dict[str, Any]:
    """The sides left, and front in 3D, move by MOVED into the body and slide freely."""
    sides = ["left", "front"][: dim - 1]
    held: list[dict[str, Any]]
    if along == "component":
        held = [
            {"on": side, "value": [MOVED if i == axis else None for i in range(dim)]}
            for axis, side in enumerate(sides)
        ]
        return {"displacements": held}
    if along == "normal":
        return {"supports": [{"on": side, "along": "normal", "value": -MOVED} for side in sides]}
    # The length of a direction does not matter.
    held = [
        {"on": side, "along": vector(2.0 * rotation[:, axis]), "value": MOVED}
        for axis, side in enumerate(sides)
    ]
    return {"supports": held}


def turned(parameters: Parameters, rotation: FloatArray) -> StudyProblem:
    """The problem on the mesh of the parameters after a rotation about the origin."""
    domain = mesh_of(parameters, MPI.COMM_WORLD)
    x = domain.mesh.geometry.x
    x[:, : len(rotation)] = x[:, : len(rotation)] @ rotation.T
    return assemble(parameters, MPI.COMM_WORLD, domain)


def pressed(dim: int, rotation: FloatArray, along: str, **changes: Any) -> Parameters:
    """A block on rollers, pulled along and pressed onto a foundation with friction."""
    pull = np.array([0.03, *[0.01] * (dim - 2), -0.05])
    given: dict[str, Any] = {
        "mesh__structured": True,
        "loads": {
            "tractions": [{"on": "top", "value": vector(rotation @ pull)}],
            **rollers(dim, rotation, along),
        },
        "friction__smoothing": {"kernel": "convolution", "radius": 0.6},
    }
    return block(dim, 0.5, **(given | changes))


def solved(dim: int, rotation: FloatArray, along: str, **changes: Any) -> StudySolution:
    solution = solve_assembled(turned(pressed(dim, rotation, along, **changes), rotation))
    assert solution.converged, solution.summary["reason"]
    return solution


def nodal(solution: StudySolution) -> FloatArray:
    """The displacements (k, d) of the local nodes."""
    return np.asarray(solution.displacement.x.array.reshape(-1, solution.domain.dim))


def differ(found: FloatArray, wanted: FloatArray) -> float:
    """The largest difference of local values relative to the largest value."""
    comm = MPI.COMM_WORLD
    most = comm.allreduce(float(np.abs(wanted).max(initial=0.0)), op=MPI.MAX)
    return comm.allreduce(float(np.abs(found - wanted).max(initial=0.0)), op=MPI.MAX) / most
