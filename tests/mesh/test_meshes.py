"""The geometries: what their groups are and measure, and how they are refined.

Every process meshes its own copy, so the file runs on any number of ranks.
"""

import math
import signal
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gmsh_groups import Array, make, measures, read

from contact_locking.meshes import BUILDERS, build, write

pytestmark = pytest.mark.serial

pytest.importorskip("gmsh")

PI = math.pi
CAP = 2 * PI * (1 - math.sqrt(1 - 0.25**2))  # of the unit sphere, within 1/4 of its axis
ARC = math.asin(0.25)

# Builder, parameters, exact measure of every group; the builder's own default where not given.
CASES: dict[str, tuple[str, dict[str, Any], dict[str, float]]] = {
    "block 2D": (
        "block",
        {"size": [2, 1]},
        {"body": 2, "left": 1, "right": 1, "bottom": 2, "top": 2},
    ),
    "block 3D": (
        "block",
        {"dim": 3, "size": [2, 1.5, 1], "h": 0.3, "h_contact": 0.2},
        {"body": 3, "left": 1.5, "right": 1.5, "front": 2, "back": 2, "bottom": 3, "top": 3},
    ),
    "structured block 3D": (
        "block",
        {"dim": 3, "size": [2, 1.5, 1], "h": 0.3, "structured": True},
        {"body": 3, "left": 1.5, "right": 1.5, "front": 2, "back": 2, "bottom": 3, "top": 3},
    ),
    "punch 2D": (
        "punch",
        {"h_contact": 0.05},
        {"body": 1, "symmetry": 1, "right": 1, "bottom": 1, "top": 0.75, "contact": 0.25},
    ),
    "disc": ("disc", {"half": False}, {"body": PI, "contact": 2 * ARC, "side": 2 * (PI - ARC)}),
    "quarter disc": (
        "disc",
        {"quarter": True, "contact_width": math.sqrt(0.5)},
        {"body": PI / 4, "contact": PI / 4, "side": PI / 4, "top": 1, "symmetry": 1},
    ),
    "half ball": (
        "ball",
        {"h": 0.15, "h_contact": 0.05},
        {"body": 2 * PI / 3, "contact": CAP, "side": 2 * PI - CAP, "top": PI},
    ),
    "quarter of a half ball": (
        "ball",
        {"h": 0.15, "h_contact": 0.05, "quarter": True},
        {"body": PI / 6, "contact": CAP / 4, "side": PI / 2 - CAP / 4, "top": PI / 4}
        | {"symmetry_x": PI / 4, "symmetry_y": PI / 4},
    ),
    "annulus": ("annulus", {}, {"body": 3 * PI, "inner": 2 * PI, "outer": 4 * PI}),
    "quarter annulus": (
        "annulus",
        {"quarter": True},
        {"body": 3 * PI / 4, "inner": PI / 2, "outer": PI, "bottom": 1, "left": 1},
    ),
    "L-shape 3D": (
        "l_shape",
        {"dim": 3, "size": [2, 0.5, 1], "notch": [1.6, 0.7], "h": 0.2},
        {"body": 0.44, "bottom": 1, "left": 0.5, "right": 0.15, "top": 0.2, "front": 0.88}
        | {"back": 0.88, "inner_horizontal": 0.8, "inner_vertical": 0.35},
    ),
    "inclusion 2D": (
        "inclusion",
        {},
        {"body": 1 - PI / 16, "inclusion": PI / 16, "left": 1, "right": 1, "bottom": 1, "top": 1},
    ),
    "inclusion 3D": (
        "inclusion",
        {"dim": 3, "size": [1, 1, 2], "radius": 0.4, "centre": [0.5, 0.5, 1.4], "h": 0.15},
        {"body": 2 - 4 / 3 * PI * 0.4**3, "inclusion": 4 / 3 * PI * 0.4**3}
        | {"left": 2, "right": 2, "front": 2, "back": 2, "bottom": 1, "top": 1},
    ),
    "stack 3D": (
        "stack",
        {"dim": 3, "h": 0.3, "slope": 0.75},
        {"lower": 1, "upper": 1, "left": 0.625, "right": 1.375, "front": 1, "back": 1}
        | {"bottom": 1, "lower_top": 1.25, "upper_left": 1.375, "upper_right": 0.625}
        | {"upper_front": 1, "upper_back": 1, "upper_bottom": 1.25, "top": 1},
    ),
    "structured stack 2D": (
        "stack",
        {"h": 0.3, "slope": 0.4, "upper": [0.5, 1.0], "structured": True},
        {"lower": 1, "upper": 0.5, "left": 0.8, "right": 1.2, "bottom": 1, "upper_left": 1.1}
        | {"upper_right": 0.9, "lower_top": math.hypot(1, 0.4)}
        | {"upper_bottom": math.hypot(0.5, 0.2), "top": 0.5},
    ),
    "disc in a ring": (
        "disc_in_ring",
        {},
        {"disc": PI, "ring": 3 * PI, "rim": 2 * PI, "inner": 2 * PI, "outer": 4 * PI},
    ),
    "a disc between two fingers": (
        "grip",
        {"width": 0.4, "length": 2.0},
        {"ball": PI, "left": 1.2, "right": 1.2, "rim": 2 * PI}
        | {"left_pad": 3, "left_root": 0.4, "left_back": 3.4}
        | {"right_pad": 3, "right_root": 0.4, "right_back": 3.4},
    ),
    "quarter of a ring in a ring": (
        "disc_in_ring",
        {"radius": 1.01, "hole": 0.5, "quarter": True},
        {"disc": PI * (1.01**2 - 0.25) / 4, "ring": 3 * PI / 4, "rim": 1.01 * PI / 2}
        | {"hole": PI / 4, "inner": PI / 2, "outer": PI, "bottom": 1.51, "left": 1.51},
    ),
}


def test_grains_touch_and_do_not_overlap_in_any_unit_of_length() -> None:
    unit: Any = make("grains", count=12, width=6.0)
    discs = np.array(unit.discs)
    pairs = [(i, j) for i in range(12) for j in range(i)]
    gaps = [np.hypot(*(discs[i] - discs[j])[:2]) - discs[i, 2] - discs[j, 2] for i, j in pairs]
    assert min(gaps) > -1e-8 and sum(gap < 1e-8 for gap in gaps) >= 12
    assert np.all(discs[:, 0] - discs[:, 2] > -1e-8) and np.all(discs[:, 1] - discs[:, 2] > -1e-8)
    scaled: Any = make("grains", count=12, width=6.0e-3, radius=1.0e-3, h=1e-4)
    assert np.array(scaled.discs) == pytest.approx(1e-3 * discs, rel=1e-6)
    with build(make("grains", count=3, width=6.0, h=0.2)) as model:
        points, cells, _ = read(model, 2)
    area = measures(points, cells["grains"]).sum()
    assert area == pytest.approx(make("grains", count=3, width=6.0, h=0.2).measure, rel=0.02)


def longest_edge(points: Array, simplices: Array) -> Array:
    """The longest edge of every simplex."""
    corners = points[simplices]
    return np.linalg.norm(corners[:, :, None] - corners[:, None], axis=-1).max(axis=(1, 2))


@pytest.mark.parametrize("case", CASES)
def test_groups_cover_body_and_boundary_exactly_once(case: str) -> None:
    name, given, exact = CASES[case]
    geometry = make(name, **given)
    with build(geometry) as model:
        points, cells, facets = read(model, geometry.dim)

    count_of_cells = sum(len(simplices) for simplices in cells.values())
    if given.get("structured"):
        assert count_of_cells == geometry.estimated_cells()
    else:
        assert 0.4 < count_of_cells / geometry.estimated_cells() < 2.2
    assert tuple(cells) == geometry.cell_names
    assert tuple(facets) == geometry.facet_names
    assert set(cells) | set(facets) == set(exact)

    # Facets inscribed in a curve of radius r leave out a share of up to 3/8 (h / r)^2, the ball's.
    radius = given.get("radius", {"annulus": 1, "inclusion": 0.25}.get(name, 1))
    curved = name in ("disc", "ball", "annulus", "inclusion", "disc_in_ring", "grip")
    for group, simplices in (cells | facets).items():
        ratio = 4 * geometry.finest / radius if group == "contact" else geometry.h / radius
        tolerance = 0.4 * ratio**2 if curved else 1e-10
        assert measures(points, simplices).sum() == pytest.approx(exact[group], rel=tolerance)
    assert geometry.measure == pytest.approx(sum(exact[part] for part in cells))

    # The facets of a single cell are the boundary, and every one of them has one name.
    inside = np.concatenate(list(cells.values()))
    count: Counter[tuple[int, ...]] = Counter()
    for corner in range(geometry.dim + 1):
        opposite = np.sort(np.delete(inside, corner, axis=1), axis=1)
        count.update(tuple(map(int, facet)) for facet in opposite)
    boundary = sorted(facet for facet, times in count.items() if times == 1)
    named = sorted(tuple(sorted(map(int, facet))) for group in facets.values() for facet in group)
    assert named == boundary
    assert set(np.unique(inside)) == set(range(len(points))), "a node belongs to no cell"


@pytest.mark.parametrize(
    ("name", "given", "contact", "far"),
    [
        ("block", {"dim": 3, "h": 0.3, "h_contact": 0.08}, "bottom", "top"),
        ("disc", {"h": 0.2, "h_contact": 0.02}, "contact", "top"),
        ("ball", {"h": 0.3, "h_contact": 0.05}, "contact", "top"),
        ("annulus", {"h": 0.3, "h_contact": 0.05}, "inner", "outer"),
        ("l_shape", {"h": 0.2, "h_contact": 0.03}, "bottom", "top"),
    ],
)
def test_contact_is_meshed_with_h_contact_and_the_far_side_with_h(
    name: str, given: dict[str, Any], contact: str, far: str
) -> None:
    geometry = make(name, **given)
    with build(geometry) as model:
        points, _, facets = read(model, geometry.dim)
    assert longest_edge(points, facets[contact]).mean() == pytest.approx(
        given["h_contact"], rel=0.3
    )
    assert longest_edge(points, facets[contact]).max() < 2 * given["h_contact"]
    assert np.median(longest_edge(points, facets[far])) == pytest.approx(given["h"], rel=0.4)


@pytest.mark.parametrize(
    ("name", "given"),
    [("block", {"dim": 3, "h": 0.25}), ("ball", {"h": 0.25, "h_contact": 0.1}), ("annulus", {})],
)
def test_same_parameters_give_the_same_mesh_to_the_bit(
    name: str, given: dict[str, Any], tmp_path: Path
) -> None:
    geometry = make(name, **given)
    write(geometry, tmp_path / "first.msh")
    with build(make("disc")):
        pass  # another mesh in between, which must not change the next
    write(geometry, tmp_path / "second.msh")
    assert (tmp_path / "first.msh").read_bytes() == (tmp_path / "second.msh").read_bytes()


@pytest.mark.parametrize("name", BUILDERS)
def test_a_body_has_the_same_mesh_in_another_unit_of_length(name: str) -> None:
    given, unit = BUILDERS[name](), 2.54e-9
    scaled: dict[str, Any] = {
        key: tuple(unit * x for x in value) if isinstance(value, tuple) else unit * value
        for key, value in ((key, getattr(given, key)) for key, _ in given.lengths())
    }
    places = []
    for geometry in (given, BUILDERS[name](**scaled)):
        with build(geometry) as model:
            places.append(model.mesh.getNodes()[1])
    assert places[1] == pytest.approx(unit * places[0], rel=1e-13, abs=1e-15 * unit)


@pytest.mark.parametrize("name", BUILDERS)
@pytest.mark.parametrize("key", ["h", "h_contact"])
def test_impossible_element_sizes_are_refused(name: str, key: str) -> None:
    bad: Any
    for bad in (0, -1, math.nan, math.inf, 1e-9, 1e60, "0.1", True, [0.1]):
        with pytest.raises(ValueError, match=f"^{key}: "):
            BUILDERS[name](**{key: bad})


@pytest.mark.parametrize(
    ("name", "given", "key"),
    [
        ("block", {"dim": 1}, "dim"),
        ("block", {"dim": 3, "size": [1, 1]}, "size"),
        ("block", {"size": 1.0}, "size"),
        ("block", {"size": [1, 0.05]}, "h"),
        ("block", {"h_contact": 0.2}, "h_contact"),
        ("block", {"structured": True, "h_contact": 0.05}, "h_contact"),
        ("block", {"h": 1e-4}, "h"),
        ("stack", {"dim": 3, "structured": True}, "structured"),
        ("stack", {"dim": 3, "cells": "box"}, "cells"),
        ("punch", {"half_width": 1.0}, "half_width"),
        ("punch", {"dim": 3, "size": [2, 0.2, 1]}, "half_width"),
        ("disc", {"contact_width": 1.0}, "contact_width"),
        ("disc", {"half": False, "quarter": True}, "quarter"),
        ("ball", {"contact_width": 1e-4}, "contact_width"),
        ("annulus", {"outer_radius": 0.5}, "inner_radius"),
        ("l_shape", {"notch": [0.5, 1]}, "notch"),
        ("inclusion", {"centre": [0.2, 0.5]}, "radius"),
    ],
)
def test_impossible_parameters_are_refused(name: str, given: dict[str, Any], key: str) -> None:
    with pytest.raises(ValueError, match=f"^{key}: "):
        BUILDERS[name](**given)


gmsh = pytest.importorskip("gmsh")


def test_failed_write_leaves_the_older_file_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "block.msh"
    path.write_text("an older file")

    def fail(name: str) -> None:
        Path(name).write_text("half a mesh")
        raise RuntimeError("disk full")

    monkeypatch.setattr(gmsh, "write", fail)
    with pytest.raises(RuntimeError, match="disk full"):
        write(make("block", h=0.5), path)
    assert path.read_text() == "an older file"
    assert list(tmp_path.iterdir()) == [path]


def test_write_refuses_another_format_and_a_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"\.msh, body\.xdmf"):
        write(make("block"), tmp_path / "body.xdmf")
    with pytest.raises(OSError):
        write(make("block"), tmp_path / "nowhere" / "body.msh")


def test_gmsh_is_silent_and_ignores_the_command_line_and_leaves_signals(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["program", "-clmax", "0.01", "-3", "nothing.geo"])
    handler = signal.getsignal(signal.SIGINT)
    geometry = make("block", h=0.5)
    with build(geometry) as model:
        assert signal.getsignal(signal.SIGINT) is handler
        assert sum(len(tags) for tags in model.mesh.getElements(2)[1]) < 50
    assert signal.getsignal(signal.SIGINT) is handler
    assert not gmsh.isInitialized()
    assert capfd.readouterr() == ("", "")


def test_gmsh_of_the_caller_is_left_as_it_was() -> None:
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.Algorithm", 5)
        gmsh.model.add("body")
        gmsh.model.occ.addPoint(1, 2, 3)
        gmsh.model.occ.synchronize()
        with build(make("block", h=0.5)) as model:
            assert len(model.getEntities(2)) == 1
        assert gmsh.isInitialized()
        assert gmsh.option.getNumber("Mesh.Algorithm") == 5
        assert gmsh.model.getCurrent() == "body"
        assert gmsh.model.getEntities() == [(0, 1)]
    finally:
        gmsh.finalize()
