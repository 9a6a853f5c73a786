"""Layers of cells that are thousands of times thinner than wide: rounding in displacements."""

from __future__ import annotations

import math
from itertools import permutations, product
from pathlib import Path

import numpy as np
import pytest
from msh import MeshElements, write_msh

from contact_locking.process import solving
from contact_locking.results.solution import Solution
from contact_locking.solver.interior_point import method
from contact_locking.solver.interior_point.tuning import Tuning
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial

# Of these heights each layer is nine times as thick as the one below.
HEIGHTS = [0.0, *np.geomspace(1.4e-4, 1.0, 5)]


def layers(file: Path) -> Path:
    """A unit cube of bricks, two by two in each layer, six tetrahedra each."""
    shape = (3, 3, len(HEIGHTS))
    numbers = np.arange(1, math.prod(shape) + 1).reshape(shape)
    points = [(0.5 * i, 0.5 * j, float(z)) for i, j, z in product(range(3), range(3), HEIGHTS)]

    def bricks(axes: tuple[int, ...], fixed: dict[int, int]) -> MeshElements:
        """The simplices along some axes, with the other coordinates ``fixed``."""
        found = []
        for corner in product(*(range(shape[axis] - 1) for axis in axes)):
            for order in permutations(axes):
                place = np.array([fixed.get(axis, 0) for axis in range(3)])
                place[list(axes)] = corner
                path = [int(numbers[tuple(place)])]
                for axis in order:
                    place[axis] += 1
                    path.append(int(numbers[tuple(place)]))
                found.append(tuple(path))
        return found

    groups = {
        "left": bricks((1, 2), {0: 0}),
        "front": bricks((0, 2), {1: 0}),
        "back": bricks((0, 2), {1: 2}),
        "body": bricks((0, 1, 2), {}),
    }
    return write_msh(file, points, groups)


def solution(mesh: Path) -> Solution:
    data = {
        "mesh": {"file": str(mesh)},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.0029},
        "loads": {
            "body_force": [0.0021388216, 0.0028327258, -0.0062069773],
            "displacements": [
                {"on": "left", "value": [0, None, None]},
                {"on": "front", "value": [None, 0, None]},
                {"on": "back", "value": [0, 0, 0]},
            ],
        },
        "contact": [],
    }
    return solving.solve(Parameters.model_validate(data))


def test_steps_are_softer_where_rounding_unbalances_the_forces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The problem is convex and u = 0 admissible, so that there is a solution for any load."""
    mesh = layers(tmp_path / "layers.msh")
    found = solution(mesh)
    assert found.converged, found.summary["reason"]
    assert found.summary["iterations"]["tangents"] <= 20
    monkeypatch.setattr(method, "Tuning", lambda: Tuning(stiffest=(math.inf, math.inf)))
    assert not solution(mesh).converged
