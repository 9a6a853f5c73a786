"""Two bodies of published benchmarks on meshes that do not match, with either side as `on`."""

from __future__ import annotations

from typing import Any

import pytest
from benchmark_bodies import solved

from contact_locking import StudySolution
from contact_locking.results.contact_points import OPEN, ContactPoints

pytest.importorskip("gmsh")
# Gmsh meshes on one rank.
pytestmark = pytest.mark.serial


def points_of(solution: StudySolution) -> ContactPoints:
    assert solution.contact_points is not None
    return solution.contact_points


def both_roles(*sides: str) -> list[dict[str, str]]:
    return [{"on": on, "against": against} for on, against in (sides, sides[::-1])]


def stacked(dim: int, contact: dict[str, str], **mesh: Any) -> dict[str, Any]:
    return {
        "mesh": {"builder": "stack", "dim": dim} | mesh,
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
        "contact": contact,
    }


def pressed(dim: int, by: float) -> dict[str, Any]:
    held = [("bottom", [0.0] * dim), ("top", [0.0] * (dim - 1) + [-by])]
    return {"displacements": [{"on": on, "value": value} for on, value in held]}


def beyond(points: ContactPoints, size: float, axis: int = 0) -> float:
    """How far points under pressure are outside of 0 < x < size along an axis."""
    x = points.x[points.state != OPEN, axis]
    return max(-x.min(), x.max() - size, 0.0)


BLOCKS = both_roles("upper_bottom", "lower_top")


@pytest.mark.parametrize("contact", BLOCKS)
@pytest.mark.parametrize("h_upper", [0.07, 0.055, 0.037, 0.033])
def test_no_pressure_is_a_force_over_a_sliver(h_upper: float, contact: dict[str, str]) -> None:
    """The last facet of the wider block is cut in any ratio.

    At the edge the pressure grows as a weak power of the distance, to 2 times the mean at a facet
    of 0.033 or 0.037.
    """
    study = stacked(2, contact, size=[1.0, 0.5], upper=[1.2, 0.5], h=0.1, h_upper=h_upper)
    solution = solved(study, loads=pressed(2, 0.02))
    mean = abs(solution.summary["contact_force"][1])
    assert mean == pytest.approx(0.025, rel=0.02)
    assert solution.summary["pressure_max"] < 2.1 * mean
    assert beyond(points_of(solution), 1.0) <= 0.5 * h_upper


@pytest.mark.parametrize("contact", BLOCKS)
def test_crossed_blocks_press_only_where_they_face_each_other(contact: dict[str, str]) -> None:
    """The upper block is wider along x, and the lower one along y."""
    sizes = {"size": [1.0, 1.0, 0.5], "upper": [1.2, 0.8, 0.5]}
    study = stacked(3, contact, h=0.2, h_upper=0.13, **sizes)
    solution = solved(study, loads=pressed(3, 0.02))
    assert abs(solution.summary["contact_force"][2]) == pytest.approx(0.0204, rel=0.01)
    assert solution.summary["pressure_max"] < 2.0 * 0.0204 / 0.8
    points = points_of(solution)
    assert beyond(points, 1.0) <= 0.065
    points.x[:, 1] -= 0.1
    assert beyond(points, 0.8, axis=1) <= 0.1
