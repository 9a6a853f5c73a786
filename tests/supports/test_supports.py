"""Supports along the normal of the boundary or along a given direction."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from slow import slow
from turned_supports import MOVED, differ, holds, nodal, solved, turn

from contact_locking.results.solution import StudySolution
from contact_locking.running.assembly import StudyProblem, assemble, mesh_of
from contact_locking.running.solving import solve_assembled
from contact_locking.study_file.parameters import Parameters


@functools.cache
def unturned(dim: int, degree: int, n: float) -> StudySolution:
    """The block on rollers that fix components."""
    return solved(dim, np.eye(dim), "component", **sharp(degree, n))


def sharp(degree: int, n: float) -> dict[str, Any]:
    """Two solutions to the default tolerance of 1e-8 may differ by more than the test allows."""
    discretisation = {"degree": degree}
    return {"penalty__n": n, "discretisation": discretisation, "solver__tolerance": 1e-10}


@pytest.mark.parametrize(
    ("dim", "degree", "n", "along"),
    [
        (2, 1, math.inf, "given"),
        (2, 1, 1e3, "normal"),
        slow(2, 1, math.inf, "normal"),
        slow(2, 1, 1e3, "given"),
        pytest.param(2, 2, math.inf, "given", marks=pytest.mark.serial),
        slow(2, 2, 1e3, "normal"),
        slow(3, 1, math.inf, "given"),
        pytest.param(3, 1, 1e3, "normal", marks=pytest.mark.serial),
    ],
)
def test_oblique_rollers_of_a_turned_block_are_the_rollers_of_the_block(
    dim: int, degree: int, n: float, along: str
) -> None:
    rotation = turn(dim)
    wanted = unturned(dim, degree, n)
    found = solved(dim, rotation, along, **sharp(degree, n))
    assert differ(nodal(found) @ rotation, nodal(wanted)) < 1e-9
    reactions = found.summary["reactions"]
    assert set(reactions) == set(wanted.summary["reactions"])
    for name, force in wanted.summary["reactions"].items():
        assert np.array(reactions[name]) @ rotation == pytest.approx(np.array(force), abs=1e-9)
    assert holds(found)
    assert holds(wanted)


@pytest.mark.serial
def test_iterative_solvers_keep_the_held_directions() -> None:
    rotation, solver = turn(2), {"linear": "iterative", "tolerance": 1e-10}
    found, wanted = solved(2, rotation, "given", solver=solver), unturned(2, 1, 1e3)
    assert differ(nodal(found) @ rotation, nodal(wanted)) < 1e-6
    normal = rotation[:, 0]
    points = found.displacement.function_space.tabulate_dof_coordinates()[:, :2]
    left = np.abs(points @ normal) < 1e-9
    assert left.sum() == 3
    assert np.allclose((nodal(found) @ normal)[left], MOVED, rtol=0, atol=1e-15)


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
