"""Supports along the normal of the boundary or along a given direction."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import pytest
from slow import slow
from turned_supports import (
    MOVED,
    SIDES,
    differ,
    holds,
    nodal,
    pressed,
    rollers,
    solved,
    turn,
    turned,
    vector,
)

from contact_locking.arrays import FloatArray
from contact_locking.results.solution import StudySolution
from contact_locking.running.solving import solve_assembled


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


@pytest.mark.serial
def test_bounds_and_constants_do_not_depend_on_the_position() -> None:
    def certificate(rotation: FloatArray, along: str) -> Any:
        # Without moved supports the theory gives bounds; the top holds the rest.
        eye = rotation.T
        supports = [{"on": side, "along": vector(eye[i])} for i, side in enumerate(SIDES)]
        values = [{"on": "left", "value": [0.0, None]}, {"on": "top", "value": [None, 0.0]}]
        held: dict[str, Any] = (
            {"displacements": values} if along == "component" else {"supports": supports}
        )
        loads = {"body_force": vector(rotation @ np.array([0.01, -0.05])), **held}
        return solved(2, rotation, along, loads=loads, penalty__n=math.inf).summary["certificate"]

    wanted, found = certificate(np.eye(2), "component"), certificate(turn(2), "given")
    assert found["constants"]["c_0"] == pytest.approx(wanted["constants"]["c_0"], rel=1e-5)
    for name, bound in wanted["bounds"].items():
        assert bound["bound"] is not None
        assert found["bounds"][name]["bound"] == pytest.approx(bound["bound"], rel=1e-6)


@pytest.mark.serial
def test_a_proof_that_nothing_is_admissible_does_not_depend_on_the_position() -> None:
    def factor(rotation: FloatArray, along: str) -> list[float]:
        loads = rollers(2, rotation, along)
        across: dict[str, Any] = {"on": "right", "along": vector(rotation[:, 0]), "value": 0.1}
        foot: dict[str, Any] = {"on": "top", "along": vector(rotation[:, 1])}
        if along == "component":
            right = {"on": "right", "value": [0.1, None]}
            loads["displacements"] += [right, {"on": "top", "value": [None, 0.0]}]
        else:
            loads["supports"] += [across, foot]
        given = pressed(2, rotation, along, loads=loads, penalty__n=math.inf)
        summary = solve_assembled(turned(given, rotation)).summary
        assert not summary["converged"]
        return list(summary["admissible_load_factor"])

    assert factor(turn(2), "given") == pytest.approx(factor(np.eye(2), "component"), rel=1e-4)
