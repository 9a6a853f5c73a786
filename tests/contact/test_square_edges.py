"""Tools with square edges: the way out beside an edge, orientation, and friction beside them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import solved
from slow import slow

from contact_locking import StudySolution
from contact_locking.errors import Misplaced
from contact_locking.study_file import from_mapping

pytestmark = pytest.mark.serial

DEPTH = 0.02


def square(left: float, right: float, depth: float = DEPTH) -> list[list[float]]:
    """A flat tool with square edges that reaches into the strip of height 1 from above."""
    low, high = 1.0 - depth, 3.0
    return [[left, low], [right, low], [right, high], [left, high], [left, low]]


def pressed(foundation: dict[str, Any], **changes: Any) -> StudySolution:
    """A strip [4, 1] that stands on its bottom, with nodes at multiples of 0.1."""
    given: dict[str, Any] = {
        "mesh": {"builder": "block", "size": [4, 1], "h": 0.1, "structured": True},
        "material": {"elasticity": {"young": 5.0, "poisson": 0.3}},
        "loads": {"displacements": [{"on": "bottom", "value": [0, 0]}]},
        "contact": {"on": "top", "foundation": foundation},
        "output": {"picture": False},
    }
    solution = solved(from_mapping(given | changes))
    return solution


def force(solution: StudySolution) -> float:
    return float(solution.summary["contact_force"][-1])


def test_an_edge_near_a_node_presses_it_down_by_the_depth_of_the_flat_side() -> None:
    # The nodes at 1 and 3 are 0.005 away from the sides of the tool, and 0.02 from its front.
    near = pressed({"polyline": square(0.995, 3.005)})
    gaps, normals = near.contacts[0].gap, near.contacts[0].normal
    under = gaps < 0.0
    assert gaps[under] == pytest.approx(-DEPTH)
    assert normals[under] == pytest.approx(np.tile([0.0, 1.0], (int(under.sum()), 1)))
    # The edge at the node itself.
    at_node = pressed({"polyline": square(1.0 - 1e-9, 3.0 + 1e-9)})
    assert force(near) == pytest.approx(force(at_node), rel=1e-6)


def test_a_tool_that_no_ray_along_the_normals_leaves_within_the_body_is_refused() -> None:
    tall = [[0.995, -2.0], [3.005, -2.0], [3.005, 3.0], [0.995, 3.0], [0.995, -2.0]]
    with pytest.raises(Misplaced, match="more than the width of the body"):
        pressed({"polyline": tall})


@pytest.mark.parametrize(
    ("kernel", "degree"),
    [("convolution", 1), slow("helmholtz", 1), slow("convolution", 2), ("helmholtz", 2)],
)
def test_r_makes_no_friction_beside_a_square_tool(kernel: str, degree: int) -> None:
    solution = pressed(
        {"polyline": square(1.03, 2.97)},
        friction={"coefficient": 0.3, "smoothing": {"kernel": kernel, "radius": 0.3}},
        discretisation={"degree": degree},
    )
    fields = solution.contacts[0]
    beside = np.abs(fields.normal[:, 0]) > 0.5
    assert MPI.COMM_WORLD.allreduce(int(beside.sum())) > 15
    assert np.abs(fields.bound[beside]).max(initial=0.0) == pytest.approx(0.0, abs=1e-8)
    assert abs(solution.summary["friction_force"][1]) < 1e-6 * abs(force(solution))
    # Under the tool R averages as ever.
    assert MPI.COMM_WORLD.allreduce(float(fields.bound.max(initial=0.0)), MPI.MAX) > 0.0


def test_a_tool_that_slides_drags_no_nodes_that_it_has_left() -> None:
    # The sides of Gamma_C move with the tool.
    solution = pressed(
        {"polyline": square(1.03, 2.03), "motion": ["t", 0.0]},
        friction={"coefficient": 0.3},
        steps={"to": 0.5, "count": 2},
    )
    fields = solution.contacts[0]
    beside = np.abs(fields.normal[:, 0]) > 0.5
    assert np.abs(fields.bound[beside]).max(initial=0.0) == pytest.approx(0.0, abs=1e-8)
    assert abs(solution.summary["friction_force"][1]) < 1e-6 * abs(force(solution))
