"""The boundary outside of Gamma_C that enters a foundation is warned of, and no other boundary."""

from __future__ import annotations

import math
from typing import Any

import pytest
from problems import block

from contact_locking import StudySolution, solve

pytestmark = pytest.mark.serial

# The walls stand 0.05 to the right of the unit block, and the floor 0.01 below.
FLOOR_AND_WALL = {"polyline": [[1.05, 3.0], [1.05, -0.01], [-3.0, -0.01]]}


def solved(loads: dict[str, Any], **changes: Any) -> StudySolution:
    """A unit block that is clamped on its left."""
    clamp = {"on": "left", "value": [0.0, 0.0]}
    loads = {"tractions": [], **loads, "displacements": [clamp, *loads.get("displacements", [])]}
    without_limits: dict[str, Any] = {"material__locking_limit": math.inf, "penalty__n": math.inf}
    solution = solve(block(h=0.25, loads=loads, **without_limits, **changes))
    assert solution.converged, solution.summary["reason"]
    return solution


def about_entries(solution: StudySolution) -> list[str]:
    """The warnings about a boundary that enters a foundation."""
    found = solution.summary["warnings"]
    return [text for text in found if "enters the foundation" in text]


def warnings(loads: dict[str, Any], **changes: Any) -> list[str]:
    """These warnings of such a block."""
    return about_entries(solved(loads, **changes))


def pushed(by: float) -> dict[str, Any]:
    """The right side is moved to the right."""
    return {"displacements": [{"on": "right", "value": [by, None]}]}


def test_a_side_outside_of_gamma_c_that_enters_a_wall_is_warned_of() -> None:
    (warning,) = warnings(pushed(0.1), contact={"on": "bottom", "foundation": FLOOR_AND_WALL})
    assert warning.startswith("contact: the boundary outside of contact.on enters")
    assert "by 0.05 near (1, " in warning


@pytest.mark.parametrize("by", [0.0, 0.04, 0.051])
def test_a_side_that_hardly_reaches_the_wall_is_not_warned_of(by: float) -> None:
    assert warnings(pushed(by), contact={"on": "bottom", "foundation": FLOOR_AND_WALL}) == []


def test_nothing_is_warned_of_where_gamma_c_covers_the_boundary() -> None:
    pulled = {"tractions": [{"on": "right", "value": [0.1, 0.0]}]}
    covered = {"on": ["bottom", "right"], "foundation": FLOOR_AND_WALL}
    assert warnings(pulled, contact=covered) == []
    (warning,) = warnings(pulled, contact={"on": "bottom", "foundation": FLOOR_AND_WALL})
    assert "near (1, " in warning


def test_each_of_several_contacts_is_asked() -> None:
    ceiling_and_wall = {"polyline": [[-3.0, 1.01], [1.05, 1.01], [1.05, -3.0]]}
    contacts = [{"on": "bottom"}, {"on": "top", "foundation": ceiling_and_wall}]
    (warning,) = warnings(pushed(0.1), contact=contacts)
    assert warning.startswith("contact.1: the boundary outside of contact.1.on enters")


def test_a_foundation_that_a_force_has_moved_is_entered_where_it_is_now() -> None:
    # The force lifts the floor to the block, and moves the wall to the left as far.
    tool = {**FLOOR_AND_WALL, "force": [-1e-5, 1e-5]}
    solution = solved(pushed(0.1), contact={"on": "bottom", "foundation": tool})
    lift = solution.summary["contacts"][0]["tool"]["travel"] / math.sqrt(2.0)
    assert lift > 0.01
    (warning,) = about_entries(solution)
    assert f"by {0.05 + lift:.3g} near (1, " in warning
