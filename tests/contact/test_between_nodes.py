"""A foundation that enters the body between the nodes of Gamma_C is never missed in silence."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from problems import block
from tool_files import binary_stl, box

from contact_locking import StudySolution, solve_steps
from contact_locking.running.solving import solve
from contact_locking.study_file import from_mapping

# The top of a strip [10, 3] has a node at each whole number, and a block in space at each half.
STRIP = {"builder": "block", "size": [10, 3], "h": 1.0, "structured": True}
CUBE = {"builder": "block", "dim": 3, "size": [2, 2, 1], "h": 0.5, "structured": True}


def given(mesh: dict[str, Any], contact: dict[str, Any], **changes: Any) -> Any:
    """A body that is held at its bottom."""
    zero = [0] * mesh.get("dim", 2)
    return from_mapping(
        {
            "mesh": mesh,
            "material": {"elasticity": {"young": 5.0, "poisson": 0.45}},
            "loads": {"displacements": [{"on": "bottom", "value": zero}]},
            "contact": {"on": "top", **contact},
            "output": {"picture": False},
        }
        | changes
    )


def pressed(
    foundation: dict[str, Any], mesh: dict[str, Any] = STRIP, **changes: Any
) -> StudySolution:
    return solve(given(mesh, {"foundation": foundation}, **changes))


def assert_missed(solution: StudySolution, depth: float, at: str) -> None:
    """The criterion fails, and a warning has the depth and the place."""
    criterion = solution.summary["certificate"]["criteria"]["penetration_between_nodes"]
    assert not solution.converged and not criterion["holds"]
    assert "mesh.h_contact" in solution.summary["suggestion"]
    assert solution.summary["penetration_between_nodes"] == pytest.approx(depth, rel=0.05)
    (warning,) = [text for text in solution.summary["warnings"] if "between the nodes" in text]
    assert at in warning


@pytest.mark.serial
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(
    ("foundation", "depth"),
    [
        (
            {"polyline": [[5.7, 3], [5.7, 5], [5.3, 5], [5.3, 3], [5.5, 2.7], [5.7, 3]]},
            0.3,
        ),
        # No point of a lattice is inside of a needle.
        ({"polyline": [[5.531, 2.7], [5.532, 5], [5.53, 5], [5.531, 2.7]]}, 0.3),
        ({"cylinder": {"centre": [5.53, 3.18], "radius": 0.2}}, 0.02),
        ({"sphere": {"centre": [5.53, 3.04], "radius": 0.06}}, 0.02),
        ({"expression": "sqrt((x - 5.53)**2 + (y - 3.18)**2) - 0.2"}, 0.02),
    ],
    ids=["wedge", "needle", "roller", "small roller", "expression"],
)
def test_a_tool_between_two_nodes_fails_a_criterion(
    foundation: dict[str, Any], depth: float, degree: int
) -> None:
    # With degree 2 the nodes are half as far apart.
    moved = foundation | {"motion": [-0.25 * (degree - 1), 0.0]}
    solution = pressed(moved, discretisation={"degree": degree})
    assert_missed(solution, depth, {1: "near (5.5", 2: "near (5.2"}[degree])


@pytest.mark.serial
def test_a_body_that_moves_onto_a_tool_between_nodes_fails_a_criterion() -> None:
    # The body travels by 1 and touches the tool for the last 0.05 of the way.
    up = {"displacements": [{"on": "bottom", "value": [0, 1.0]}]}
    roller = {"cylinder": {"centre": [5.5, 4.05], "radius": 0.1}}
    assert_missed(pressed(roller, loads=up), 0.05, "near (5.5, 3)")


def test_a_tool_that_a_force_pushes_in_between_nodes_fails_a_criterion() -> None:
    teeth = [[0.4, 3], [0.5, 2.9], [0.6, 3], [9.4, 3], [9.5, 2.9], [9.6, 3], [9.6, 5], [0.4, 5]]
    solution = pressed({"polyline": [*teeth, teeth[0]], "force": [0.0, -0.1]})
    assert_missed(solution, 0.1, "near (")


@pytest.mark.serial
def test_a_roller_that_slides_from_node_to_node_stops_where_it_is_missed() -> None:
    roller = {"cylinder": {"centre": [4, 3.28], "radius": 0.3}, "motion": ["t", 0]}
    steps = {"to": 2, "count": 8}
    parameters = given(STRIP, {"foundation": roller}, steps=steps)
    (solution,) = solve_steps(parameters)
    assert solution.time == 0.25
    assert_missed(solution, 0.02, "near (4.25, 3)")
    # Facets of a third of its width do not miss it.
    fine = dict(STRIP, size=[3, 0.5], h=0.05)
    roller = {"cylinder": {"centre": [0.8, 0.78], "radius": 0.3}, "motion": ["t", 0]}
    parameters = given(fine, {"foundation": roller}, steps={"to": 0.33, "count": 3})
    forces = []
    for solution in solve_steps(parameters):
        assert solution.converged, solution.summary["reason"]
        assert not any("between the nodes" in text for text in solution.summary["warnings"])
        forces.append(solution.summary["contact_force"][1])
    assert len(forces) == 3
    assert max(forces) / min(forces) > 0.8


@pytest.mark.serial
@pytest.mark.parametrize(
    "shape",
    [
        {"sphere": {"centre": [1.17, 1.08, 1.08], "radius": 0.1}},
        {"cylinder": {"centre": [1.17, 0.0, 1.08], "radius": 0.1}},
        {"cylinder": {"centre": [1.17, 0.0, 1.08], "radius": 0.1, "axis": [1, 0, 0]}},
        {"expression": "sqrt((x - 1.17)**2 + (y - 1.08)**2 + (z - 1.08)**2) - 0.1"},
    ],
    ids=["ball", "cylinder along y", "cylinder along x", "expression"],
)
def test_a_round_tool_between_the_nodes_of_a_block_fails_a_criterion(shape: dict[str, Any]) -> None:
    if shape.get("cylinder", {}).get("axis"):
        shape = {"cylinder": shape["cylinder"] | {"centre": [0.0, 1.23, 1.08]}}
    assert_missed(pressed(shape, CUBE), 0.02, "near (")


@pytest.mark.serial
@pytest.mark.parametrize(
    "corners",
    [
        ([1.16, 1.06, 0.97], [1.2, 1.1, 2.0]),
        # A knife across the whole block, thinner than the lattice.
        ([-1.0, 1.2, 0.97], [3.0, 1.201, 2.0]),
        # A needle.
        ([1.17, 1.08, 0.97], [1.171, 1.081, 2.0]),
    ],
    ids=["pin", "knife", "needle"],
)
def test_a_surface_between_the_nodes_of_a_block_fails_a_criterion(
    corners: tuple[list[float], list[float]], tmp_path: Path
) -> None:
    file = tmp_path / "tool.stl"
    file.write_bytes(binary_stl(box(*corners)))
    assert_missed(pressed({"surface": str(file)}, CUBE), 0.03, "near (")


@pytest.mark.serial
@pytest.mark.parametrize("degree", [1, 2])
def test_what_the_nodes_see_is_not_warned_of(degree: int) -> None:
    element = {"degree": degree}
    flat = {"half_space": {"point": [0.0, 2.95], "normal": [0.0, -1.0]}}
    large = {"cylinder": {"centre": [5.0, 102.95], "radius": 100.0}}
    for foundation in (flat, large):
        solution = pressed(foundation, discretisation=element)
        assert solution.converged
        assert solution.summary["warnings"] == []
    assert pressed(flat).summary["penetration_between_nodes"] == pytest.approx(0.0, abs=1e-12)


HOLLOW = {"builder": "annulus", "quarter": True, "inner_radius": 1.0}


def around(foundation: dict[str, Any], mesh: dict[str, Any], lifted: float) -> StudySolution:
    """A quarter of a ring around a foundation, which is pulled down at one end."""
    loads = {
        "displacements": [{"on": "left", "value": [0, lifted]}],
        "forces": [{"on": "bottom", "value": [0, -0.02]}],
    }
    contact = {"on": "inner", "foundation": foundation}
    elasticity = {"young": 1e3, "poisson": 0.3}
    return solve(given(HOLLOW | mesh, contact, loads=loads, material={"elasticity": elasticity}))


@pytest.mark.serial
def test_the_chords_of_a_hollow_boundary_enter_no_drum_of_its_own_radius() -> None:
    """The chord is in front of the arc by 1.2e-3, 97 % of how far the lifted ring is pushed."""
    drum = {"cylinder": {"centre": [0, 0], "radius": 1.0}}
    solution = around(drum, {"outer_radius": 1.1, "h": 0.1}, 0.001)
    assert solution.converged and solution.summary["warnings"] == []
    assert solution.summary["penetration_between_nodes"] == 0.0
    assert 0.5 < solution.summary["contact_area"] < 1.2


@pytest.mark.serial
def test_a_wire_in_a_hollow_body_is_missed_beyond_the_chord() -> None:
    place = [0.99 * math.cos(0.82), 0.99 * math.sin(0.82)]
    wire = {"cylinder": {"centre": place, "radius": 0.02}}
    solution = around(wire, {"outer_radius": 1.4, "h": 0.2}, 0.0)
    assert_missed(solution, 0.0073, "near (0.68, 0.729)")


@pytest.mark.serial
def test_an_entry_of_the_size_of_rounding_is_none() -> None:
    """At the end of a cycle ``sin(2 pi t)`` is not zero, but 2e-16."""
    push = 0.0087 * math.sin(2.0 * math.pi)
    solution = pressed(
        {"half_space": {"point": [0.005, 0.005, 0.01 + 8.78e-6], "normal": [0.001756, 0.0, -1.0]}},
        {"builder": "block", "dim": 3, "size": [0.01] * 3, "h": 0.0035, "structured": True},
        loads={
            "displacements": [{"on": "bottom", "value": [0.0, 0.0, 0.0]}],
            "pressures": [{"on": "right", "value": push}],
        },
    )
    assert solution.converged, solution.summary["reason"]
    assert solution.summary["penetration_between_nodes"] == 0.0


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


def about_entries(solution: StudySolution) -> list[Any]:
    """The findings about a boundary that enters a foundation."""
    return [each for each in solution.warnings if each.code == "contact.uncovered"]


def warnings(loads: dict[str, Any], **changes: Any) -> list[Any]:
    """These findings of such a block."""
    return about_entries(solved(loads, **changes))


def pushed(by: float) -> dict[str, Any]:
    """The right side is moved to the right."""
    return {"displacements": [{"on": "right", "value": [by, None]}]}


@pytest.mark.serial
def test_a_side_outside_of_gamma_c_that_enters_a_wall_is_warned_of() -> None:
    (warning,) = warnings(pushed(0.1), contact={"on": "bottom", "foundation": FLOOR_AND_WALL})
    assert warning.key == "contact" and warning.numbers["place"].startswith("1, ")
    assert warning.numbers["depth"] == pytest.approx(0.05)


@pytest.mark.serial
@pytest.mark.parametrize("by", [0.0, 0.04, 0.051])
def test_a_side_that_hardly_reaches_the_wall_is_not_warned_of(by: float) -> None:
    assert warnings(pushed(by), contact={"on": "bottom", "foundation": FLOOR_AND_WALL}) == []


@pytest.mark.serial
def test_nothing_is_warned_of_where_gamma_c_covers_the_boundary() -> None:
    pulled = {"tractions": [{"on": "right", "value": [0.1, 0.0]}]}
    covered = {"on": ["bottom", "right"], "foundation": FLOOR_AND_WALL}
    assert warnings(pulled, contact=covered) == []
    (warning,) = warnings(pulled, contact={"on": "bottom", "foundation": FLOOR_AND_WALL})
    assert warning.numbers["place"].startswith("1, ")


@pytest.mark.serial
def test_a_foundation_that_a_force_has_moved_is_entered_where_it_is_now() -> None:
    # The force lifts the floor to the block, and moves the wall to the left as far.
    tool = {**FLOOR_AND_WALL, "force": [-1e-5, 1e-5]}
    solution = solved(pushed(0.1), contact={"on": "bottom", "foundation": tool})
    lift = solution.summary["contacts"][0]["tool"]["travel"] / math.sqrt(2.0)
    assert lift > 0.01
    (warning,) = about_entries(solution)
    assert f"by {0.05 + lift:.3g} near (1, " in warning
