"""Pictures of tools: the surface of a tool at its place, if there is room for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.patches import Polygon
from problems import block
from solutions import of_kind
from tool_files import box

from contact_locking import solve_steps
from contact_locking.arrays import FloatArray
from contact_locking.view.pictures import plane
from contact_locking.view.pictures.gather import gather
from contact_locking.view.pictures.style import Snapshot, drawn_tool, foundation, tool

pytestmark = pytest.mark.serial

# Counterclockwise, below the unit block.
DIE = [[0.2, -0.4], [0.8, -0.4], [0.8, -0.03], [0.6, 0.0], [0.4, 0.0], [0.2, -0.03], [0.2, -0.4]]
MOTION = {"translation": [0.05, "0.02*t"], "rotation": "0.1*t", "about": [0.5, 0.0]}


def of_a_die() -> Snapshot:
    """The second step of a block on a die that moves."""
    contact = {"on": "bottom", "foundation": {"polyline": DIE, "motion": MOTION}}
    given = block(2, 0.25, contact=contact, steps={"times": [0.5, 1.0]}, penalty__n=1e3)
    *_, last = solve_steps(given)
    body = gather(last)
    assert body is not None
    return body


def moved(points: FloatArray) -> FloatArray:
    """Where the motion has brought points (m, 2) at t = 1."""
    cosine, sine = np.cos(0.1), np.sin(0.1)
    about = np.array([0.5, 0.0])
    return about + (points - about) @ [[cosine, sine], [-sine, cosine]] + [0.05, 0.02]


def test_a_polyline_is_drawn_at_its_place() -> None:
    body = of_a_die()
    wanted = moved(np.array(DIE))
    (facets,) = body.contact.tools
    assert np.vstack([facets[:, 0], facets[-1:, 1]]) == pytest.approx(wanted)
    drawn = [
        patch.get_xy()
        for axes in plane.figure(body, {}).axes
        for patch in axes.patches
        if isinstance(patch, Polygon)
    ]
    assert any(len(xy) == len(DIE) and np.allclose(xy, wanted) for xy in drawn)


def test_a_tool_of_any_shape_is_drawn_where_motion_and_force_have_brought_it() -> None:
    disc = {"sphere": {"centre": [0.5, -0.52], "radius": 0.5}, "motion": [0.1, "0.01*t"]}
    pushed = {"sphere": {"centre": [0.5, 1.55], "radius": 0.5}, "force": [0.0, -0.01]}
    contact = [{"on": "bottom", "foundation": disc}, {"on": "top", "foundation": pushed}]
    loads = {"displacements": [{"on": "left", "value": [0, 0]}]}
    given = block(2, 0.25, contact=contact, loads=loads, steps={"times": [0.5, 1.0]})
    *_, last = solve_steps(given)
    body = gather(last)
    assert body is not None
    travel = last.contacts[1].contact.travel
    assert travel[1] < -0.04
    for facets, centre in zip(
        body.contact.tools, ([0.6, -0.51], [0.5, 1.55 + travel[1]]), strict=True
    ):
        ends = facets.reshape(-1, 2)
        assert np.linalg.norm(ends - centre, axis=1) == pytest.approx(0.5, abs=1e-4)


def with_tools(kind: str, *tools: FloatArray) -> Snapshot:
    body = gather(of_kind(3, kind))
    assert body is not None
    return replace(body, contact=replace(body.contact, tools=tools))


def test_a_tool_beside_the_body_is_drawn_as_a_whole_and_a_large_one_as_ground() -> None:
    small, large = box([0.3, 0.3, -0.5], [0.7, 0.7, 0.0]), box([-9, -9, -1], [9, 9, 0])
    x = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    assert len(drawn_tool(small, x)) == 12 and len(drawn_tool(large, x)) == 0
    assert len(drawn_tool(np.repeat(small, 2000, axis=0), x)) == 0
    body = with_tools("locked", small)
    (part,) = body.contact.parts()
    assert np.array_equal(foundation(part, 1.0, 1.0), small)
    # The displacement is magnified only over a uniform gap, where the ground moves with it.
    assert len(foundation(part, 5.0, 1.0)) == 1 and len(tool(part, 5.0)) == 0
    plain = with_tools("locked", small[:0])
    assert len(foundation(plain.contact.parts()[0], 1.0, 1.0)) == 1
