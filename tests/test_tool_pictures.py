"""Pictures of tools: the surface of a tool at its place, if there is room for it."""

from __future__ import annotations

import importlib.util
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from matplotlib.patches import Polygon
from problems import block
from solutions import of_kind
from tool_files import box

from contact_locking import solve_steps
from contact_locking.arrays import FloatArray
from contact_locking.plotting import draw, offscreen, plane, snapshot_file, views
from contact_locking.plotting.camera import from_the_side
from contact_locking.plotting.gather import gather
from contact_locking.plotting.ground import drawn_tool, foundation, tool
from contact_locking.plotting.snapshot import Snapshot

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


def test_a_polyline_is_drawn_at_its_place_and_kept_in_the_snapshot(tmp_path: Path) -> None:
    body = of_a_die()
    wanted = moved(np.array(DIE))
    (facets,) = body.contact.tools
    assert np.vstack([facets[:, 0], facets[-1:, 1]]) == pytest.approx(wanted)
    file = tmp_path / "snapshot.npz"
    snapshot_file.save(body, file)
    read = snapshot_file.load(file)
    assert np.array_equal(read.contact.tools[0], facets)
    drawn = [
        patch.get_xy()
        for axes in plane.figure(read).axes
        for patch in axes.patches
        if isinstance(patch, Polygon)
    ]
    assert any(len(xy) == len(DIE) and np.allclose(xy, wanted) for xy in drawn)


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


def test_a_damaged_tool_in_a_snapshot_is_refused(tmp_path: Path) -> None:
    from contact_locking import InputError

    small = box([0.3, 0.3, -0.5], [0.7, 0.7, 0.0])
    for bad in (small[0], small[:, :2], np.full_like(small, np.nan)):
        snapshot_file.save(with_tools("locked", bad), tmp_path / "snapshot.npz")
        with pytest.raises(InputError, match="is damaged"):
            snapshot_file.load(tmp_path / "snapshot.npz")


def test_a_tool_on_top_is_seen_from_above() -> None:
    body = with_tools("locked", box([0.3, 0.3, 1.0], [0.7, 0.7, 1.5]))
    upside = replace(body.contact.points, normal=-body.contact.points.normal)
    body = replace(body, contact=replace(body.contact, points=upside))
    assert views.views(body)[views.BODY].camera.towards == pytest.approx(
        from_the_side(np.zeros(3)), abs=1e-6
    )
    ground = replace(body, contact=replace(body.contact, tools=()))
    assert views.views(ground)[views.BODY].camera.towards[2] < 0.0


def test_matplotlib_alone_draws_a_tool_in_space(tmp_path: Path) -> None:
    body = with_tools("locked", box([0.3, 0.3, -0.5], [0.7, 0.7, 0.0]))
    draw.draw(body, tmp_path / "picture.png")
    assert matplotlib.image.imread(tmp_path / "picture.png").size > 0


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("pyvista") is None or shutil.which("xvfb-run") is None,
    reason="PyVista or xvfb-run is not installed",
)
def test_a_tool_is_in_the_views_in_space(tmp_path: Path) -> None:
    image: list[Any] = []
    for count in (12, 0):
        file = tmp_path / f"{count}.npz"
        snapshot_file.save(with_tools("locked", box([0.3, 0.3, -0.5], [0.7, 0.7, 0])[:count]), file)
        image.append(offscreen.views(file)[views.BODY])
    with_it, without = image
    assert with_it.shape != without.shape or (with_it != without).any()
