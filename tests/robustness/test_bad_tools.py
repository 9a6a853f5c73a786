"""Tools that are refused, each with what is wrong and how it would be right, or warned of."""

from __future__ import annotations

import itertools
import json
import math
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest
from changed_study import changed
from mpi4py import MPI
from problems import block
from tool_files import ascii_stl, binary_stl, box

from contact_locking import InputError, StudySolution, solve, study_file
from contact_locking.arrays import FloatArray
from contact_locking.command import cli
from contact_locking.files import LARGEST_FILE
from contact_locking.findings import Finding
from contact_locking.meshes.geometry import empty_model
from contact_locking.running import assembly
from contact_locking.running.assembly import assemble
from contact_locking.shapes.tool_files import read_stl
from contact_locking.study_file import from_mapping

pytestmark = pytest.mark.serial


Corners = Sequence[tuple[float, float]]


def _block(occ: Any, low: Sequence[float], high: Sequence[float]) -> int:
    return int(occ.addBox(*low, *np.subtract(high, low)))


def _extruded(occ: Any, corners: Corners, width: float = 0.6) -> None:
    """The polygon in the plane of x and z, of a width along y."""
    points = [occ.addPoint(x, -width / 2, z) for x, z in corners]
    lines = [occ.addLine(a, b) for a, b in itertools.pairwise([*points, points[0]])]
    occ.extrude([(2, occ.addPlaneSurface([occ.addCurveLoop(lines)]))], 0.0, width, 0.0)


def _teeth(count: int, width: float) -> Corners:
    pitch = 0.8 / count
    low = [(-0.4 + pitch * (i + share), z) for i in range(count) for share, z in (
        (0.0, 0.2), (0.5 - width / 2, 0.0), (0.5 + width / 2, 0.0))]  # fmt: skip
    return [*low, (0.4, 0.2), (0.4, 0.5), (-0.4, 0.5)]


def _cross(occ: Any) -> None:
    one, other = ((-0.1, -0.3, 0.0), (0.1, 0.3, 0.5)), ((-0.3, -0.1, 0.0), (0.3, 0.1, 0.5))
    occ.fuse([(3, _block(occ, *one))], [(3, _block(occ, *other))])


def _holed(occ: Any) -> None:
    hole = _block(occ, (-0.175, -0.175, -0.1), (0.175, 0.175, 0.6))
    occ.cut([(3, _block(occ, (-0.35, -0.35, 0.0), (0.35, 0.35, 0.5)))], [(3, hole)])


def _half_ring(occ: Any) -> None:
    outer, inner = (occ.addCylinder(0, 0, 0, 0, 0, 0.5, r, angle=math.pi) for r in (0.4, 0.2))
    occ.cut([(3, outer)], [(3, inner)])


def _bowl(occ: Any) -> None:
    outer = occ.addCylinder(0, 0, 0, 0, 0, 0.5, 0.4)
    occ.cut([(3, outer)], [(3, occ.addCone(0, 0, 0, 0, 0, 0.2, 0.2, 0.02))])


def _two_shells(occ: Any) -> None:
    _block(occ, (-0.35, -0.3, 0.0), (-0.1, 0.3, 0.5))
    _block(occ, (0.1, -0.3, 0.0), (0.35, 0.3, 0.5))


_BELL = [(-0.4, 0.0), (-0.2, 0.0), (-0.2, 0.2), (0.2, 0.2), (0.2, 0.0), (0.4, 0.0), (0.4, 0.5),
         (-0.4, 0.5)]  # fmt: skip
# Tools that stand on z = 0.
SHAPES: dict[str, Callable[[Any], object]] = {
    "half ring": _half_ring,
    "cylinder": lambda occ: occ.addCylinder(0, 0, 0, 0, 0, 0.5, 0.3),
    "cross": _cross,
    "cube with a hole": _holed,
    "two shells": _two_shells,
    "torus": lambda occ: occ.addTorus(0, 0, 0.1, 0.3, 0.1),
    "dumbbell": lambda occ: _extruded(occ, _BELL),
    "bowl": _bowl,
    "hemisphere": lambda occ: occ.addSphere(0, 0, 0.4, 0.4, angle1=-math.pi / 2, angle2=0.0),
    "wedge": lambda occ: _extruded(occ, [(0.0, 0.0), (0.3, 0.3), (-0.3, 0.3)]),
    "cone": lambda occ: occ.addCone(0, 0, 0, 0, 0, 0.25, 0.002, 0.4),
    "plate with teeth": lambda occ: _extruded(occ, _teeth(5, 0.08)),
    "plate with a needle": lambda occ: _extruded(occ, _teeth(1, 0.01)),
}


def triangles(shape: str) -> FloatArray:
    """The surface of a shape (n, 3, 3), seen counterclockwise from outside."""
    with empty_model(shape) as model:
        SHAPES[shape](model.occ)
        model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 24)
        for _, volume in model.getEntities(3):
            model.mesh.setOutwardOrientation(volume)
        model.mesh.generate(2)
        tags, places, _ = model.mesh.getNodes()
        corners = model.mesh.getElementsByType(2)[1]
        order = np.argsort(tags)
        rows = order[np.searchsorted(tags, corners, sorter=order)]
        return np.asarray(places.reshape(-1, 3)[rows].reshape(-1, 3, 3))


BELOW = box([-1.0, -1.0, -1.0], [2.0, 2.0, -0.005])
TEXT, BINARY = ascii_stl(BELOW), binary_stl(BELOW)


def warned(foundation: dict[str, Any], dim: int = 3) -> list[Finding]:
    """The findings about the tool below a body."""
    from mpi4py import MPI

    h = 0.5 if dim == 3 else 0.25
    given = block(dim, h, contact={"on": "bottom", "foundation": foundation})
    problem = assemble(given, MPI.COMM_SELF)
    problem.close()
    return [each for each in problem.findings if each.key.startswith("contact.foundation")]


def written(folder: Path, triangles: FloatArray) -> dict[str, Any]:
    file = folder / "tool.stl"
    file.write_bytes(ascii_stl(triangles))
    return {"surface": {"file": str(file)}}


def refusal(foundation: dict[str, Any], dim: int = 3) -> str:
    with pytest.raises(InputError) as error:
        warned(foundation, dim)
    assert error.value.key is not None and error.value.key.startswith("contact.foundation")
    return str(error.value)


def test_a_good_tool_has_no_warning(tmp_path: Path) -> None:
    assert warned(written(tmp_path, BELOW)) == []


def test_an_open_tool_is_warned_of_and_its_rim_must_not_be_behind_the_body(tmp_path: Path) -> None:
    top = BELOW[8:10]
    assert np.ptp(top[:, :, 2]) == 0.0
    (open_,) = warned(written(tmp_path, top))
    assert (open_.code, open_.numbers["count"]) == ("foundation.open", 4)
    small = top * [0.2, 0.2, 1.0]
    first, second = warned(written(tmp_path, small))
    assert (first.code, second.code) == ("foundation.open", "foundation.end")
    said = refusal(written(tmp_path, small + np.array([0.0, 0.0, 0.1])))
    assert "reaches around the end of the open foundation" in said


def test_a_closed_tool_that_is_inside_out_is_turned_with_a_finding(tmp_path: Path) -> None:
    inverted = written(tmp_path, BELOW[:, ::-1])
    assert [finding.code for finding in warned(inverted)] == ["foundation.turned"]
    assert warned({"surface": inverted["surface"] | {"turned": True}}) == []
    square = [[-2, -0.005], [-2, -3], [3, -3], [3, -0.005], [-2, -0.005]]
    assert [x.code for x in warned({"polyline": square[::-1]}, 2)] == ["foundation.turned"]
    assert warned({"polyline": square}, 2) == []


def test_an_open_tool_that_is_inside_out_is_refused_and_can_be_turned(tmp_path: Path) -> None:
    line = [[-2, -0.005], [3, -0.005]]
    assert "reverse the corners" in refusal({"polyline": line}, 2)
    assert warned({"polyline": line[::-1]}, 2) == []
    assert "change the sign of expression" in refusal({"expression": "-y - 0.005"}, 2)


def test_degenerate_triangles_and_copies_are_left_out(tmp_path: Path) -> None:
    needle = np.array([[BELOW[0, 0], BELOW[0, 0], BELOW[0, 1]], [BELOW[0, 0]] * 3])
    bad = np.concatenate([BELOW, needle, BELOW[3:4], BELOW[5:6, [1, 2, 0]]])
    flat, copies = warned(written(tmp_path, bad))
    assert (flat.code, flat.numbers["count"]) == ("foundation.degenerate", 2)
    assert (copies.code, copies.numbers["count"]) == ("foundation.copies", 2)
    assert "degenerate triangles only" in refusal(written(tmp_path, needle))


def test_an_edge_of_three_triangles_is_refused(tmp_path: Path) -> None:
    a, b = BELOW[0, :2]
    wall = np.array([[a, b, [0.5, 0.5, -0.5]]])
    said = refusal(written(tmp_path, np.concatenate([BELOW, wall])))
    assert "3 triangles share the edge from" in said and "two sides only where two do" in said


def test_triangles_that_look_to_different_sides_are_refused(tmp_path: Path) -> None:
    for whole in (BELOW, BELOW[8:10]):
        mixed = whole.copy()
        mixed[1] = mixed[1, ::-1]
        assert "different sides" in refusal(written(tmp_path, mixed))


def test_a_tool_far_away_or_in_other_units_is_warned_of(tmp_path: Path) -> None:
    (far,) = warned(written(tmp_path, BELOW - [0.0, 0.0, 30.0]))
    assert (far.code, far.key) == ("foundation.far", "contact.foundation")
    assert far.numbers == pytest.approx({"extent": 1.0, "distance": 30.0}, rel=1e-3)
    for scale in (1000.0, 0.001):
        size, *_ = warned(written(tmp_path, scale * BELOW))
        assert size.code == "foundation.size"
        assert size.numbers == pytest.approx({"extent": 1.0, "size": 3.0 * scale})
    (far,) = warned({"half_space": {"point": [0, -30], "normal": [0, 1]}}, 2)
    assert (far.code, far.numbers["distance"]) == ("foundation.far", pytest.approx(30.0))


@pytest.mark.parametrize(
    "content",
    [
        TEXT[:300],
        BINARY[:-20],
        binary_stl(BELOW, 4_000_000_000),
        binary_stl(BELOW[:0]),
        b"solid\nendsolid\n",
        b"<html>tool</html>" * 20,
        TEXT.replace(b"vertex 2 ", b"vertex two "),
        TEXT.replace(b"vertex 2 ", b"vertex nan "),
        TEXT.replace(b"vertex 2 ", b"vertex 1e300 "),
        b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n1 0 0",
    ],
    ids=range(10),
)
def test_a_file_that_is_no_tool_is_refused(content: bytes, tmp_path: Path) -> None:
    file = tmp_path / "tool.stl"
    file.write_bytes(content)
    assert "tool.stl" in refusal({"surface": {"file": str(file)}})


def test_any_damage_to_a_file_is_read_or_refused(tmp_path: Path) -> None:
    random, file = np.random.default_rng(7), tmp_path / "tool.stl"
    for whole in (TEXT, BINARY):
        for _ in range(60):
            data = np.frombuffer(whole, dtype=np.uint8).copy()
            data[random.integers(len(data), size=3)] = random.integers(256, size=3)
            file.write_bytes(data[: random.integers(1, len(data) + 1)].tobytes())
            try:
                assert read_stl(file).shape[1:] == (3, 3)
            except InputError as error:
                assert "tool.stl" in str(error)


@pytest.mark.parametrize(
    "make",
    [
        lambda file: None,
        lambda file: file.mkdir(),
    ],
)
def test_a_missing_file_is_a_fault_of_the_study_file(make: Any, tmp_path: Path) -> None:
    file = tmp_path / "tool.stl"
    make(file)
    for surface in ("tool.stl", {"file": "tool.stl"}):
        given = {"mesh": {"dim": 3}, "contact": [{"foundation": {"surface": surface}}]}
        with pytest.raises(InputError) as error:
            from_mapping(given, tmp_path)
        assert "contact.0.foundation.surface" in str(error.value)


def test_a_file_of_a_gigabyte_is_refused_by_its_size_alone(tmp_path: Path) -> None:
    file = tmp_path / "tool.stl"
    with file.open("wb") as stream:
        stream.truncate(1_000_000_000)
    began = time.perf_counter()
    with pytest.raises(InputError, match="has 1000 MB, and at most 250 MB are read"):
        read_stl(file)
    assert time.perf_counter() - began < 1.0
    assert LARGEST_FILE < 1_000_000_000


@pytest.mark.parametrize(
    "corners",
    [
        [[0, 0], [0, 0]],
        [[0, 0], [2, 0], [2, 1], [1, -1]],
        [[0, 0], [2, 0], [1, 0]],
        [[0, 0], [1, 0], [1, 1], [0.5, 0]],
    ],
)
def test_a_polyline_that_has_no_sides_is_refused(corners: list[Any]) -> None:
    refusal({"polyline": corners}, 2)


@pytest.mark.parametrize(
    "text",
    [
        "x,y\n0,0\n1,zwei\n",
        "0,0\n1,nan\n",
        "0\n1\n",
        "x,y\n",
        "\0",
    ],
)
def test_a_file_that_is_no_polyline_is_refused(text: str, tmp_path: Path) -> None:
    file = tmp_path / "profile.csv"
    file.write_text(text)
    refusal({"polyline": str(file)}, 2)


def test_an_expression_without_a_direction_is_refused() -> None:
    refusal({"expression": "(x - 0.25)**2 + y**2"}, 2)
    refusal({"expression": "0.1"}, 2)


DEPTH = 0.02
# The share by which the force of a coarse mesh may be off that of a fine mesh: a tool is 0.6 wide,
# and the contact ends half a facet too early or too late on each side.
NEAR = {0.25: 0.5, 0.125: 0.2}
# Shapes with a tip or a ridge, which facets of a multiple of the depth can miss.
SHARP = ("wedge", "cone", "plate with teeth", "plate with a needle")
# The other shapes with flat or round sides of the size of the facets of the finer pad.
BLUNT = tuple(set(SHAPES) - {*SHARP, "hemisphere"})


def pressed(shape: str, h: float, folder: Path) -> StudySolution:
    """A pad whose nodes are not placed by the tool, which is turned and off the middle."""
    cosine, sine = np.cos(0.3), np.sin(0.3)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    file = folder / "tool.stl"
    file.write_bytes(binary_stl(triangles(shape) @ turn.T + [0.51, 0.47, 0.5 - DEPTH]))
    return solve(
        from_mapping(
            {
                "mesh": {
                    "builder": "block",
                    "dim": 3,
                    "size": [1.0, 1.0, 0.5],
                    "h": h,
                    "structured": True,
                },
                "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
                "loads": {"displacements": [{"on": "bottom", "value": [0, 0, 0]}]},
                "contact": {"on": "top", "foundation": {"surface": str(file)}},
                "output": {"picture": False},
            }
        )
    )


def force(solution: StudySolution) -> float:
    return -float(solution.summary["contact_force"][2])


def check(shape: str, sizes: list[float], finest: float, folder: Path) -> None:
    fine = force(pressed(shape, finest, folder))
    for h in sizes:
        solution = pressed(shape, h, folder)
        told = [text for text in solution.summary["warnings"] if "between the nodes" in text]
        assert not any("inside out" in text for text in solution.summary["warnings"])
        assert solution.converged or (told and shape in SHARP), solution.summary["reason"]
        if shape in BLUNT or not told:
            assert force(solution) == pytest.approx(fine, rel=NEAR[h]), h


@pytest.mark.parametrize("shape", ["cross", "cone"])
def test_a_shape_on_a_coarse_pad_has_the_force_or_a_warning(shape: str, tmp_path: Path) -> None:
    check(shape, [0.25], 0.125, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("shape", sorted(SHAPES))
def test_every_shape_on_every_pad_has_the_force_or_a_warning(shape: str, tmp_path: Path) -> None:
    check(shape, [0.25, 0.125], 0.0625, tmp_path)


def _findings(folder: Path, changes: dict[str, Any]) -> list[Finding]:
    """The findings of ``check``."""
    return assembly.check(study_file.load(changed(folder, changes)).parameters)["findings"]


@pytest.mark.parametrize("load", ["-0.1 if x < 0.3 else 0", "-0.1*sqrt(x)", "-0.1*sin(5*x)"])
def test_jumps_and_bends_of_a_load_are_not_warned_of(load: str, tmp_path: Path) -> None:
    tractions = [{"on": "top", "value": [0, load]}]
    changes = {"mesh.h": 0.15, "loads.tractions": tractions, "loads.body_force": [0, load]}
    assert _findings(tmp_path, changes) == []


@pytest.mark.parametrize(
    "contact", [{"gap": -1.5}, {"foundation": {"half_space": {"point": [0, 2], "normal": [0, 1]}}}]
)
def test_a_body_wholly_inside_the_foundation_is_warned_of(
    contact: dict[str, Any], tmp_path: Path
) -> None:
    (finding,) = _findings(tmp_path, {"contact": {"on": "bottom"} | contact})
    assert (finding.code, finding.key) == ("gap.inside", f"contact.{next(iter(contact))}")
    assert _findings(tmp_path, {"contact": {"on": "bottom", "gap": -0.01}}) == []


def test_loads_and_strains_beyond_the_theory_are_warned_of_in_numbers_that_one_can_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Newtons and millimetres beside pascals lead to such loads."""
    changes = {"loads.tractions": [{"on": "top", "value": [0, -5e8]}]}
    words = ["--output", str(tmp_path / "out"), "--quiet", "--set", "output={picture: false}"]
    assert cli.main(["run", str(changed(tmp_path, changes)), *words]) == 0
    errors = capsys.readouterr().err
    assert "loads.tractions.0.value: reaches 2.6e+08 times the stiffness" in errors
    assert "e+08 times its limit: penalty.n: " in errors
    assert "this theory is for small strains: check that the units" in errors
    assert max(map(len, re.findall(r"\d+", errors))) < 4
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [f"warning: {text}" for text in summary["warnings"]] == errors.splitlines()


@pytest.mark.parametrize("kernel", ["convolution", "helmholtz"])
def test_the_default_radius_is_not_warned_of_and_smooths(kernel: str, tmp_path: Path) -> None:
    changes = {"friction.smoothing": {"kernel": kernel}, "mesh.h": 0.25}
    study = study_file.load(changed(tmp_path, changes))
    made = assemble(study.parameters, MPI.COMM_SELF)
    assert made.findings == []
    (contact,) = made.contacts
    x = contact.surface.points[:, 0]
    # The value at each node takes part of its neighbours'.
    one = np.where(x == x.max(), 1.0, 0.0)
    smoothed = contact.friction.smoothing.apply(one)
    assert 0.0 < np.sort(smoothed)[-2] < smoothed.max() < 0.9
    made.close()


def test_a_filter_with_a_huge_radius_is_the_mean(tmp_path: Path) -> None:
    changes = {"friction.smoothing": {"kernel": "helmholtz", "radius": 1e6}, "mesh.h": 0.1}
    made = assemble(study_file.load(changed(tmp_path, changes)).parameters, MPI.COMM_SELF)
    (contact,) = made.contacts
    surface, smoothing = contact.surface, contact.friction.smoothing
    w = np.exp(surface.points[:, 0])
    # The node at the clamp takes no part.
    held = np.isclose(surface.points[:, 0], 0.0)
    is_free = (~held).astype(float)
    mean = surface.integral(w * is_free) / surface.integral(is_free)
    assert np.abs(smoothing.apply(w) - mean).max() < 1e-6
    assert np.abs(smoothing.apply(np.ones_like(w)) - 1.0).max() < 1e-14
    smoothing.destroy()


@pytest.mark.parametrize("radius", [0.01, 0.25])
def test_a_radius_that_is_not_above_the_mesh_size_is_a_finding(
    radius: float, tmp_path: Path
) -> None:
    (finding,) = _findings(tmp_path, {"friction.smoothing.radius": radius, "mesh.h": 0.25})
    assert (finding.code, finding.key) == ("smoothing.radius", "friction.smoothing.radius")
    assert finding.numbers["size"] == pytest.approx(0.25) and finding.numbers["on"] == "bottom"


def _pressed_from_above(foundation: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A layer below a ball."""
    return {
        "mesh": {"size": [3, 3], "h": 0.4, "h_contact": 0.05, "axisymmetric": True},
        "material.elasticity": {"young": 1, "poisson": 0.2},
        "loads": {"displacements": [{"on": "bottom", "value": [0, 0]}]},
        "contact": {"on": "top", "foundation": foundation},
        "friction": {"coefficient": 0.2, "smoothing": {"kernel": "none"}},
    } | more


def _ball(height: float, **more: Any) -> dict[str, Any]:
    return {"sphere": {"centre": [0, height], "radius": 1}} | more


def test_friction_on_a_ball_that_is_drawn_at_its_last_place_is_warned_of(tmp_path: Path) -> None:
    """Its friction force is 0.00477, and that of the ball that came there 0.00240."""
    (finding,) = _findings(tmp_path, _pressed_from_above(_ball(3.94)))
    assert (finding.code, finding.key) == ("foundation.overlap", "contact.foundation")
    assert finding.numbers["depth"] == pytest.approx(0.06, rel=1e-3)


@pytest.mark.parametrize(
    "changes",
    [
        _pressed_from_above(_ball(4.0, motion=[0, -0.06])),
        _pressed_from_above(_ball(3.94), friction={"coefficient": 0.0}),
        _pressed_from_above(_ball(3.9999)),
        _pressed_from_above({"half_space": {"point": [0, 2.94], "normal": [0, -1]}}),
        {
            "mesh": {"builder": "annulus", "inner_radius": 1, "outer_radius": 2, "h": 0.3},
            "loads": {"displacements": [{"on": "outer", "value": [0, 0]}]},
            "contact": {
                "on": "inner",
                "foundation": {"cylinder": {"centre": [0, 0], "radius": 1.01}},
            },
        },
    ],
    ids=["it comes there", "without friction", "a touch", "a plane", "a press fit"],
)
def test_other_foundations_with_friction_are_not_warned_of(
    changes: dict[str, Any], tmp_path: Path
) -> None:
    assert _findings(tmp_path, changes) == []


@pytest.mark.parametrize("moves", [False, True])
def test_a_foundation_at_right_angles_to_the_contact_is_warned_of_unless_it_moves(
    moves: bool, tmp_path: Path
) -> None:
    foundation = {"expression": "x + 1"} | ({"motion": [0, 0]} if moves else {})
    found = _findings(tmp_path, {"contact": {"on": "bottom", "foundation": foundation}})
    keys = [each.key for each in found if each.code == "foundation.right_angles"]
    assert keys == ([] if moves else ["contact.foundation.expression"])
