"""Supports along the normals of a curved boundary: a sector of a ring."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from turned_supports import differ, holds, nodal

from contact_locking.running.solving import solve_assembled
from contact_locking.study.assembly import StudyProblem, assemble, mesh_of
from contact_locking.study_file.parameters import Parameters


def sector(n: float, **changes: Any) -> Parameters:
    """A sector of 60 degrees of a ring between the radii 1 and 2, see :func:`bent`."""
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "size": [1.0, 1.0], "h": 0.125, "structured": True},
        "material": {
            "elasticity": {"young": 1.0, "poisson": 0.3},
            "locking_limit": changes.pop("limit", math.inf),
        },
        "loads": {
            "supports": [
                {"on": "bottom", "along": [0, 1]},
                {"on": "top", "along": "normal"},
                {"on": "right", "along": "normal", "value": 0.01},
            ]
        },
        "contact": [],
        "penalty": {"n": n},
        **changes,
    }
    return Parameters.model_validate(data)


def bent(parameters: Parameters) -> StudyProblem:
    """The problem with the unit block bent to the sector: x + 1 is the radius."""
    domain = mesh_of(parameters, MPI.COMM_WORLD)
    x = domain.mesh.geometry.x
    radius, angle = 1.0 + x[:, 0], x[:, 1] * math.pi / 3.0
    x[:, 0], x[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
    return assemble(parameters, MPI.COMM_WORLD, domain)


@pytest.mark.parametrize("n", [pytest.param(1e4, marks=pytest.mark.serial), math.inf])
def test_a_sector_pulled_along_its_normals_has_the_displacement_of_the_ring(n: float) -> None:
    solution = solve_assembled(bent(sector(n)))
    assert solution.converged
    assert holds(solution)
    points = solution.displacement.function_space.tabulate_dof_coordinates()[:, :2]
    radius = np.linalg.norm(points, axis=1, keepdims=True)
    # Plane strain: u_r = A r + B/r without traction at r = 1, so that B = A/(1 - 2 nu).
    ratio = 1.0 / (1.0 - 2.0 * 0.3)
    size = 0.01 / (2.0 + ratio / 2.0)
    exact = size * (radius + ratio / radius) * points / radius
    assert differ(nodal(solution), exact) < 0.02
    side = np.abs(points[:, 1] - math.sqrt(3.0) * points[:, 0]) < 1e-9
    normal = np.array([-math.sqrt(3.0), 1.0]) / 2.0
    assert np.abs(nodal(solution)[side] @ normal).max(initial=0.0) < 1e-15


@pytest.mark.serial
def test_the_reactions_of_a_sector_balance() -> None:
    summary = solve_assembled(bent(sector(math.inf))).summary
    total = np.sum(list(summary["reactions"].values()), axis=0)
    assert set(summary["reactions"]) == {"bottom", "top", "right"}
    assert np.abs(total).max() < 1e-9
    # No part of the boundary has friction: the bottom pushes along y only.
    assert summary["reactions"]["bottom"][0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.serial
def test_a_locked_sector_keeps_the_limit() -> None:
    solution = solve_assembled(bent(sector(math.inf, limit=0.008)))
    assert solution.converged, solution.summary["reason"]
    assert holds(solution)
    assert solution.summary["locked_fraction"] > 0.0
