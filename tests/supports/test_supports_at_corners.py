"""Supports at corners, supports that contradict each other, and supports over time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block
from turned_supports import nodal, turned

from contact_locking import InputError
from contact_locking.running.assembly import assemble
from contact_locking.running.solving import solve_assembled
from contact_locking.study_file import from_mapping
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial


def corner(*supports: dict[str, Any], **more: Any) -> Parameters:
    """A unit square with supports and no contact."""
    loads = {"supports": list(supports), **more}
    return block(2, 0.5, mesh__structured=True, contact=[], loads=loads)


def test_two_directions_at_a_corner_are_both_prescribed() -> None:
    solution = solve_assembled(
        turned(
            corner(
                {"on": "left", "along": [1, 0.5], "value": 0.01},
                {"on": "bottom", "along": [-0.5, 1], "value": "0.02 + 0.01*x"},
                {"on": "right", "along": [1, 0.5], "value": 0.01},
            ),
            np.eye(2),
        )
    )
    assert solution.converged
    points = solution.displacement.function_space.tabulate_dof_coordinates()
    at = np.linalg.norm(points, axis=1) < 1e-12
    first, second = np.array([1.0, 0.5]), np.array([-0.5, 1.0])
    wanted = (0.01 * first + 0.02 * second) / math.sqrt(1.25)
    assert np.allclose(nodal(solution)[at], wanted, rtol=0, atol=1e-16)


@pytest.mark.parametrize(
    ("supports", "displacements", "key"),
    [
        (
            [{"on": "left", "along": [1, 1]}, {"on": "bottom", "along": [1, 1], "value": 0.1}],
            [],
            "loads.supports.0",
        ),
        (
            [{"on": "left", "along": [0, 2], "value": 0.1}],
            [{"on": "bottom", "value": [0, 0]}],
            "loads.supports.0",
        ),
        (
            [{"on": "left", "along": [1, 1]}, {"on": "bottom", "along": [1, 1.001]}],
            [],
            "loads.supports.1",
        ),
        ([{"on": ["left", "bottom"], "along": "normal"}], [], "loads.supports.0.along"),
        ([{"on": ["left", "right"], "along": [1, 1]}], [], "loads.displacements"),
    ],
)
def test_supports_that_contradict_each_other_are_refused(
    supports: list[dict[str, Any]], displacements: list[dict[str, Any]], key: str
) -> None:
    with pytest.raises(InputError) as caught:
        assemble(corner(*supports, displacements=displacements), MPI.COMM_WORLD)
    assert caught.value.key == key


def _moved(*values: list[Any]) -> dict[str, Any]:
    """A square whose left side and bottom have prescribed displacements, in this order."""
    pairs = zip(("left", "bottom"), values, strict=True)
    return {"displacements": [{"on": on, "value": value} for on, value in pairs]}


def _square(loads: dict[str, Any], **changes: Any) -> Parameters:
    return block(2, 0.25, contact=[], loads=loads, **changes)


@pytest.mark.parametrize("degree", [1, 2])
def test_two_displacements_of_a_shared_node_are_refused_with_both_keys(degree: int) -> None:
    loads = _moved([0, -0.01], [None, 0])
    with pytest.raises(InputError) as caught:
        assemble(_square(loads, discretisation__degree=degree), MPI.COMM_WORLD)
    assert caught.value.key == "loads.displacements.0.value.1"
    assert "loads.displacements.1.value.1" in str(caught.value)


@pytest.mark.parametrize(
    "bottom", [[None, "-0.01*(1 + x)"], [0, None], [None, -0.01 * (1 + 1e-12)]]
)
def test_displacements_that_agree_at_a_shared_node_both_hold(bottom: list[Any]) -> None:
    problem = assemble(_square(_moved([0, -0.01], bottom)), MPI.COMM_WORLD)
    problem.constraints.apply(problem.u)
    points = problem.u.function_space.tabulate_dof_coordinates()
    at = np.linalg.norm(points, axis=1) < 1e-12
    assert np.allclose(problem.u.x.array.reshape(-1, 2)[at], [0.0, -0.01], rtol=1e-9)
    problem.close()


def test_displacements_that_part_at_a_shared_node_are_refused_at_that_time() -> None:
    loads = _moved([0, "-0.01*t"], [None, "-0.01*t*t"])
    problem = assemble(_square(loads, steps={"times": [1, 2]}), MPI.COMM_WORLD)
    with pytest.raises(InputError, match=r"prescribes -0\.02 for .* prescribes -0\.04"):
        problem.advance(2.0)
    problem.close()


@pytest.mark.parametrize(
    ("support", "key"),
    [
        ({"on": "roof", "along": "normal"}, "loads.supports.0.on"),
        ({"on": "top", "along": [0, 0]}, "loads.supports.0.along"),
        ({"on": "top", "along": "tangent"}, "loads.supports.0.along"),
        ({"on": "top", "along": [0, 1], "value": "t"}, "loads.supports.0.value"),
    ],
)
def test_a_wrong_support_is_refused_with_its_key(support: dict[str, Any], key: str) -> None:
    given = {
        "mesh": {"builder": "block"},
        "loads": {"supports": [support]},
        "contact": {"on": "bottom"},
    }
    with pytest.raises(InputError) as caught:
        from_mapping(given)
    assert key in str(caught.value)


def test_a_body_that_its_normals_leave_free_to_turn_is_refused() -> None:
    supports = [{"on": ["contact", "side"], "along": "normal"}]
    given = {
        "mesh": {"builder": "disc", "h": 0.25, "half": False},
        "loads": {"supports": supports},
        "contact": [],
    }
    with pytest.raises(InputError, match="rotation"):
        assemble(from_mapping(given), MPI.COMM_WORLD)
