"""Tools that are refused, each with what is wrong and how it would be right, or warned of."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cad_shapes import SHAPES
from problems import block
from tool_files import ascii_stl, binary_stl, box

from contact_locking import InputError, StudySolution, solve
from contact_locking.arrays import FloatArray
from contact_locking.files.readable import LARGEST_FILE
from contact_locking.shapes.tool_files import read_stl
from contact_locking.study.assembly import assemble
from contact_locking.study_file import from_mapping

pytestmark = pytest.mark.serial

BELOW = box([-1.0, -1.0, -1.0], [2.0, 2.0, -0.005])
TEXT, BINARY = ascii_stl(BELOW), binary_stl(BELOW)


def warned(foundation: dict[str, Any], dim: int = 3) -> list[str]:
    """The warnings about the tool below a body."""
    from mpi4py import MPI

    h = 0.5 if dim == 3 else 0.25
    given = block(dim, h, contact={"on": "bottom", "foundation": foundation})
    problem = assemble(given, MPI.COMM_SELF)
    problem.close()
    return [text for text in problem.warnings if text.startswith("contact.foundation")]


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
    assert "the surface is open, 4 edges have one triangle only" in open_
    small = top * [0.2, 0.2, 1.0]
    first, second = warned(written(tmp_path, small))
    assert "open" in first and "lies beyond the end of the open foundation" in second
    said = refusal(written(tmp_path, small + np.array([0.0, 0.0, 0.1])))
    assert "reaches around the end of the open foundation" in said


def test_a_closed_tool_that_is_inside_out_is_turned_with_a_warning(tmp_path: Path) -> None:
    inverted = written(tmp_path, BELOW[:, ::-1])
    (said,) = warned(inverted)
    assert "the body is not in the hole" in said and "turned: true" in said
    assert warned({"surface": inverted["surface"] | {"turned": True}}) == []
    square = [[-2, -0.005], [-2, -3], [3, -3], [3, -0.005], [-2, -0.005]]
    (said,) = warned({"polyline": square[::-1]}, 2)
    assert "the body is not in the hole" in said and "reverse the corners" in said
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
    assert "2 degenerate triangles were left out" in flat
    assert "2 copies of triangles were left out" in copies
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
        assert "look to different sides" in refusal(written(tmp_path, mixed))


def test_a_tool_far_away_or_in_other_units_is_warned_of(tmp_path: Path) -> None:
    (far,) = warned(written(tmp_path, BELOW - [0.0, 0.0, 30.0]))
    assert "contact.foundation: the body is 1 long, and the foundation is 30 away" in far
    first, *_ = warned(written(tmp_path, 1000.0 * BELOW))
    assert "it is 3e+03 long, and the body 1; are its units those of the mesh?" in first
    first, *_ = warned(written(tmp_path, 0.001 * BELOW))
    assert "it is 0.003 long" in first
    (far,) = warned({"half_space": {"point": [0, -30], "normal": [0, 1]}}, 2)
    assert "30 away from Gamma_C" in far


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
        lambda file: file.write_bytes(b""),
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
    given = {"mesh": {"dim": 3}, "contact": {"foundation": {"surface": "tool.stl"}}}
    with pytest.raises(InputError, match="has 1000 MB, and at most 250 MB are read"):
        from_mapping(given, tmp_path)
    with pytest.raises(InputError, match="at most 250 MB"):
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
SHARP = ("crescent", "wedge", "cone", "pyramid", "plate with teeth", "plate with a needle")
# The other shapes with flat or round sides of the size of the facets of the finer pad.
BLUNT = tuple(set(SHAPES) - {*SHARP, "hemisphere", "frustum"})


def pressed(shape: str, h: float, folder: Path) -> StudySolution:
    """A pad whose nodes are not placed by the tool, which is turned and off the middle."""
    cosine, sine = np.cos(0.3), np.sin(0.3)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    file = folder / "tool.stl"
    file.write_bytes(binary_stl(SHAPES[shape] @ turn.T + [0.51, 0.47, 0.5 - DEPTH]))
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
