"""Pictures of tools: the surface of a tool at its place, if there is room for it."""

from __future__ import annotations

import importlib.util
import shutil
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Polygon
from mpi4py import MPI
from problems import block
from solutions import of_kind
from tool_files import box

from contact_locking import assemble, solve_steps
from contact_locking.arrays import FloatArray
from contact_locking.contact.outline import box_around, outline
from contact_locking.laws.foundation import Cylinder, HalfSpace, Sphere
from contact_locking.laws.rigid_motion import RigidMotion, rotation
from contact_locking.view.pictures import contact_map, offscreen, plane, views
from contact_locking.view.pictures.gather import gather
from contact_locking.view.pictures.snapshot import Snapshot, drawn_tool, foundation, tool
from contact_locking.view.pictures.views import from_the_side

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
        for axes in plane.figure(body).axes
        for patch in axes.patches
        if isinstance(patch, Polygon)
    ]
    assert any(len(xy) == len(DIE) and np.allclose(xy, wanted) for xy in drawn)


# The unit block with what is beside it.
BOX = np.array([[-0.25, -0.25], [1.25, 1.25]])


@pytest.mark.parametrize("radius", [0.2, 0.5, 4.0])
def test_the_outline_of_a_disc_is_its_circle_inside_the_box(radius: float) -> None:
    motion = RigidMotion(np.array([0.1, -0.05]), rotation(np.array([0.3])), np.array([0.5, 0.5]))
    centre = np.array([0.5, 1.0 + radius])
    facets = outline(Sphere((0.5, 1.0 + radius), radius), motion, BOX)
    ends, middles = facets.reshape(-1, 2), facets.mean(axis=1)
    moved = motion.place(centre[:, None])[:, 0]
    assert np.linalg.norm(ends - moved, axis=1) == pytest.approx(radius, rel=1e-3)
    assert np.all((ends >= BOX[0]) & (ends <= BOX[1]))
    # The disc is on the left of the way along its circle.
    along = facets[:, 1] - facets[:, 0]
    inwards = along[:, 0] * (moved - middles)[:, 1] - along[:, 1] * (moved - middles)[:, 0]
    assert np.all(inwards > 0.0)
    # All of the circle that is in the box is there.
    angle = np.linspace(-np.pi, np.pi, 10_001)
    circle = moved + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    inside = np.all((circle > BOX[0]) & (circle < BOX[1]), axis=1)
    length = np.linalg.norm(along, axis=1).sum()
    assert length == pytest.approx(2.0 * np.pi * radius * inside.mean(), rel=3e-3)


def test_the_outline_of_a_half_space_is_its_line_across_the_box() -> None:
    facets = outline(HalfSpace((0.0, -0.1), (0.0, 2.0)), RigidMotion.rest(2), BOX)
    assert facets[..., 1] == pytest.approx(-0.1)
    assert np.sort(facets[..., 0].ravel())[[0, -1]] == pytest.approx(BOX[:, 0])


def test_the_outline_of_an_expression_is_its_zeros_and_none_where_it_has_no_values() -> None:
    def of(text: str) -> FloatArray:
        contact = {"on": "bottom", "foundation": {"expression": text}}
        given = block(2, 0.5, contact=contact)
        (tool,) = (contact.foundation for contact in assemble(given, MPI.COMM_SELF).contacts)
        return tool.outline(BOX)

    facets = of("y + 0.1 + 0.05*cos(2*pi*x)")
    x, y = facets.reshape(-1, 2).T
    assert y == pytest.approx(-0.1 - 0.05 * np.cos(2.0 * np.pi * x), abs=1e-4)
    assert x.min() == BOX[0, 0] and x.max() == BOX[1, 0]
    # The square root has no values on the left of the block.
    assert len(of("y + 0.1 + 0.001*sqrt(x + 0.01)")) == 0


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


def test_of_a_body_of_revolution_tools_are_drawn_up_to_its_axis() -> None:
    box = box_around(np.array([[0.0, 0.0], [1.0, 0.8]]), axisymmetric=True)
    assert box == pytest.approx(np.array([[0.0, -0.25], [1.25, 1.05]]))


@pytest.mark.parametrize("radius", [0.3, 5.0])
def test_a_ball_is_closed_and_of_a_large_one_there_is_the_cap_beside_the_body(
    radius: float,
) -> None:
    box = np.array([[-0.25] * 3, [1.25] * 3])
    motion = RigidMotion(np.array([0.0, 0.1, 0.0]), np.eye(3), np.zeros(3))
    centre = np.array([0.5, 0.4, 1.0 + radius])
    facets = outline(Sphere(tuple(centre), radius), motion, box)
    moved = centre + motion.translation
    assert np.linalg.norm(facets - moved, axis=2) == pytest.approx(radius)
    sides = facets[:, [1, 2, 0]] - facets
    assert np.linalg.norm(sides, axis=2).min() > 0.0
    ends = np.round(np.stack([facets, facets[:, [1, 2, 0]]], axis=2).reshape(-1, 2, 3), 9)
    ends = np.take_along_axis(ends, np.lexsort(np.moveaxis(ends, 2, 0)[::-1])[..., None], axis=1)
    _, count = np.unique(ends.reshape(-1, 6) + 0.0, axis=0, return_counts=True)
    if radius < 1.0:
        assert np.all(count == 2)
    else:
        assert np.sum(count == 1) == 48
        assert np.ptp(facets.reshape(-1, 3)[:, 0]) == pytest.approx(1.5, rel=0.01)
        assert facets[..., 2].min() == pytest.approx(1.0, abs=1e-9)
    # A cylinder in space has no outline.
    cylinder = Cylinder(tuple(centre), radius, (0.0, 1.0, 0.0))
    assert outline(cylinder, motion, box).shape == (0, 3, 3)


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


def test_each_contact_has_its_own_tool() -> None:
    small = box([0.3, 0.3, -0.5], [0.7, 0.7, 0.0])
    body = with_tools("with two contacts", small, small[:0])
    assert [len(tool(part, 1.0)) for part in body.contact.parts()] == [12, 0]


def test_a_tool_on_top_is_seen_from_above() -> None:
    body = with_tools("locked", box([0.3, 0.3, 1.0], [0.7, 0.7, 1.5]))
    upside = replace(body.contact.points, normal=-body.contact.points.normal)
    body = replace(body, contact=replace(body.contact, points=upside))
    towards = views.side_camera(body, 1.0).towards
    assert towards == pytest.approx(from_the_side(np.zeros(3)), abs=1e-6)
    ground = replace(body, contact=replace(body.contact, tools=(np.empty((0, 3, 3)),)))
    assert views.side_camera(ground, 1.0).towards[2] < 0.0


def test_a_map_shows_all_of_a_plane_beside_a_tool_with_steep_sides() -> None:
    body = with_tools("locked", np.empty((0, 3, 3)))
    # Most points are beside the tool, where the normals point along the plane.
    normal = np.tile([0.96, 0.0, -0.28], (len(body.contact.points), 1))
    assert contact_map.frame(replace(body.contact.points, normal=normal)) == (0, 1, True)


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("pyvista") is None or shutil.which("xvfb-run") is None,
    reason="PyVista or xvfb-run is not installed",
)
def test_a_tool_is_in_the_views_in_space() -> None:
    image: list[Any] = []
    for count in (12, 0):
        body = with_tools("locked", box([0.3, 0.3, -0.5], [0.7, 0.7, 0])[:count])
        image.append(next(iter(offscreen.views(body).values())))
    with_it, without = image
    assert with_it.shape != without.shape or (with_it != without).any()
