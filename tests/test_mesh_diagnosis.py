"""Meshes that are no body are refused with entity and place; suspicious ones are warned of."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from msh import Simplices, msh, write_msh

from contact_locking import check, solve
from contact_locking.command import cli
from contact_locking.errors import InputError
from contact_locking.mesh_file import reader, topology
from contact_locking.meshes import BUILDERS, Geometry, write
from contact_locking.parameters import Parameters
from contact_locking.problem.domain import from_file, from_geometry
from contact_locking.problem.groups import Group, groups

Points = list[tuple[float, ...]]
Groups = dict[str, Simplices]

SQUARE: Points = [(0, 0), (1, 0), (1, 1), (0, 1)]
EDGES: Groups = {"bottom": [(1, 2)], "top": [(3, 4)], "left": [(4, 1)]}
BODY: Groups = {**EDGES, "body": [(1, 2, 3), (1, 3, 4)]}
FAR: Points = [(3, 0), (4, 0), (3, 1)]

# Two tetrahedra on either side of the triangle (1, 2, 3).
SPIRE: Points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1)]
TWO: Groups = {"left": [(1, 3, 4)], "body": [(1, 2, 3, 4), (1, 3, 2, 5)]}


def grid(x: float, y: float, first: int, n: int) -> tuple[Points, Simplices]:
    """A unit square of n by n squares, two triangles each, whose points count from ``first``."""
    points: Points = [(x + i / n, y + j / n) for j in range(n + 1) for i in range(n + 1)]
    corners = [first + j * (n + 1) + i for j in range(n) for i in range(n)]
    up = [(c, c + 1, c + n + 2) for c in corners]
    return points, up + [(c, c + n + 2, c + n + 1) for c in corners]


def side_by_side(n: int, m: int, gap: float = 0.0) -> tuple[Points, Groups]:
    """Two grids that meet in x = 1 without shared nodes, as where fragment was forgotten."""
    one, left = grid(0, 0, 1, n)
    two, right = grid(1 + gap, 0, len(one) + 1, m)
    sides: Groups = {"left": [(1, n + 2)], "right": [(len(one) + m + 1, len(one) + 2 * m + 2)]}
    return one + two, {**sides, "one": left, "two": right}


def moved(points: Points, number: int, place: tuple[float, ...]) -> Points:
    return [place if i == number else point for i, point in enumerate(points, start=1)]


REFUSED: dict[str, tuple[Points, Groups, list[str]]] = {
    "a coordinate that is no number": (
        moved(SQUARE, 3, (math.nan, 1)),
        BODY,
        ["node 3 at (nan, 1)", "not finite numbers"],
    ),
    "an infinite coordinate": (moved(SQUARE, 2, (1, math.inf)), BODY, ["node 2 at (1, inf)"]),
    "three triangles on an edge": (
        [*SQUARE, (1.5, -0.5)],
        {**EDGES, "body": [(1, 2, 3), (1, 3, 4), (1, 3, 5)]},
        ["3 triangles share one edge", "nodes 1 and 3 at (0.5, 0.5)", "4, 5 and 6"],
    ),
    "three tetrahedra on a face": (
        [*SPIRE, (0.2, 0.2, 2)],
        {"left": [(1, 3, 4)], "body": [*TWO["body"], (1, 2, 3, 6)]},
        ["3 tetrahedra share one face", "nodes 1, 2 and 3", "2, 3 and 4"],
    ),
    "a triangle twice": (
        SQUARE,
        {**EDGES, "body": [(1, 2, 3), (2, 3, 1), (1, 3, 4)]},
        ["triangle 5 is triangle 4 once more, at (0.666667, 0.333333)"],
    ),
    "a tetrahedron twice": (
        SPIRE,
        {"left": [(1, 3, 4)], "body": [*TWO["body"], (4, 3, 2, 1)]},
        ["tetrahedron 4 is tetrahedron 2 once more"],
    ),
    "a triangle with a node twice": (
        SQUARE,
        {**EDGES, "body": [(1, 2, 3), (1, 3, 4), (1, 1, 2)]},
        ["triangle 6 at (0.333333, 0) has the same node twice"],
    ),
    "a triangle without area": (
        [*SQUARE, (2, 2)],
        {**EDGES, "body": [(1, 2, 3), (1, 3, 4), (1, 3, 5)]},
        ["triangle 6 at (1, 1) has collapsed", "one line"],
    ),
    "a tetrahedron without volume": (
        moved(SPIRE, 5, (0.6, 0.6, 0)),
        TWO,
        ["tetrahedron 3 at", "has collapsed", "one plane"],
    ),
    "a triangle turned over": (
        moved(SQUARE, 4, (0.8, 0.2)),
        BODY,
        ["triangle 4 at", "neighbour 5 overlap", "nodes 1 and 3"],
    ),
    "a tetrahedron turned over": (
        moved(SPIRE, 5, (0.1, 0.1, 0.5)),
        TWO,
        ["tetrahedron 2 at", "neighbour 3 overlap"],
    ),
    "two squares that share no nodes": (
        *side_by_side(2, 2),
        ["two parts of the body touch", "nodes 3 and 10 are both at (1, 0)", "fragment"],
    ),
    "two triangles that share no nodes": (
        [*SQUARE, (0, 0), (1, 1)],
        {**EDGES, "body": [(1, 2, 3), (5, 6, 4)]},
        ["two parts of the body touch", "nodes 1 and 5 are both at (0, 0), and 2 more"],
    ),
    "nodes that nearly are at one place": (
        [*SQUARE, (1e-7, 0), (1, 1 + 1e-7)],
        {**EDGES, "body": [(1, 2, 3), (5, 6, 4)]},
        ["two parts of the body touch", "nodes 1 and 5"],
    ),
    "a whole body twice": (
        SQUARE + SQUARE,
        {**BODY, "again": [(5, 6, 7), (5, 7, 8)]},
        ["two parts of the body touch", "and 6 more"],
    ),
    "a hanging node": (
        [*SQUARE, (0.5, 0.5)],
        {**EDGES, "body": [(1, 2, 3), (1, 5, 4), (5, 3, 4)]},
        ["node 5 at (0.5, 0.5) hangs", "edge of triangle 4 (nodes 1 and 3)"],
    ),
    "a hanging node in space": (
        [*SPIRE, (0.25, 0.25, 0)],
        {"left": [(1, 3, 4)], "body": [(1, 2, 3, 4), (1, 2, 6, 5), (2, 3, 6, 5), (3, 1, 6, 5)]},
        ["node 6 at (0.25, 0.25, 0) hangs", "face of tetrahedron 2 (nodes 1, 2 and 3)"],
    ),
    "a cell in no group": (
        SQUARE,
        {**EDGES, "body": [(1, 2, 3)], "": [(1, 3, 4)]},
        ["cells outside every physical group", "triangle 5 at (0.333333, 0.666667)"],
    ),
    "no group of cells": (SQUARE, {**EDGES, "": [(1, 2, 3), (1, 3, 4)]}, ["no physical group"]),
    "a facet in two groups": (
        SQUARE,
        {"bottom": [(1, 2)], "sole": [(2, 1)], "left": [(4, 1)], "body": BODY["body"]},
        ["'bottom' and 'sole' share line 2 at (0.5, 0)"],
    ),
    "a node above the plane": (
        [(0, 0, 0), (1, 0, 0), (1, 1, 0.5), (0, 1, 0)],
        BODY,
        ["a surface in space", "node 3 has z = 0.5"],
    ),
    "a name with commands for the terminal": (
        SQUARE,
        {**BODY, "\x1b[2J": [(2, 3)]},
        ["cannot be printed", r"'\x1b[2J'"],
    ),
    "triangles that share no nodes at all": (
        [(3 * i + x, y) for i in range(101) for x, y in SQUARE[:3]],
        {"body": [(3 * i + 1, 3 * i + 2, 3 * i + 3) for i in range(101)]},
        ["falls into 101 parts"],
    ),
}


@pytest.mark.serial
@pytest.mark.parametrize("case", REFUSED)
def test_a_mesh_that_is_no_body_is_refused_with_entity_and_place(case: str, tmp_path: Path) -> None:
    points, groups, expected = REFUSED[case]
    path = write_msh(tmp_path / "body.msh", points, groups)
    with pytest.raises(InputError) as caught:
        from_file(path, MPI.COMM_SELF)
    message = str(caught.value)
    assert message.startswith(str(path)) and caught.value.key == "mesh.file"
    for words in expected:
        assert words in message


def builder(name: str, **given: Any) -> Geometry:
    return BUILDERS[name](**given)


def study(path: Path, **changes: Any) -> Parameters:
    """The mesh, clamped on the left and pressed onto the ground."""
    data: dict[str, Any] = {
        "mesh": {"file": str(path)},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
        "loads": {"displacements": [{"on": "left", "value": [0, -0.01]}]},
        "contact": {"on": "bottom", "gap": 0.005},
        "friction": {"coefficient": 0, "smoothing": {"kernel": "none"}},
    }
    return Parameters.model_validate({**data, **changes})


def shared(comm: MPI.Intracomm, tmp_path: Path, points: Points, groups: Groups) -> Path:
    """A mesh file of rank 0 that all ranks read."""
    folder = Path(comm.bcast(str(tmp_path)))
    if comm.rank == 0:
        write_msh(folder / "body.msh", points, groups)
    comm.Barrier()
    return folder / "body.msh"


def test_a_group_off_the_body_is_refused_where_it_is_used_and_else_warned_of(
    comm: MPI.Intracomm, tmp_path: Path
) -> None:
    named: Groups = {"dangling": [(5, 6)], **BODY}
    path = shared(comm, tmp_path, [*SQUARE, (2, 0), (3, 0)], named)
    (warning,) = check(study(path), comm)["warnings"]
    assert "group 'dangling' does not lie on the body: line 1 at (2.5, 0)" in warning
    with pytest.raises(InputError, match="'dangling' does not lie on the body") as caught:
        check(study(path, contact={"on": "dangling"}), comm)
    assert caught.value.key == "contact.on"


def test_a_line_across_a_cell_does_not_lie_on_the_body(comm: MPI.Intracomm, tmp_path: Path) -> None:
    path = shared(comm, tmp_path, SQUARE, {**BODY, "across": [(2, 4)]})
    with pytest.raises(InputError, match=r"'across' does not lie on the body: line 6"):
        from_file(path, comm).facets(["across"])


def test_a_group_inside_the_body_is_refused_where_it_is_used(
    comm: MPI.Intracomm, tmp_path: Path
) -> None:
    path = shared(comm, tmp_path, SQUARE, {**BODY, "diagonal": [(1, 3)]})
    assert check(study(path), comm)["warnings"] == []
    with pytest.raises(InputError, match="'diagonal' lies inside the body") as caught:
        check(study(path, contact={"on": "diagonal"}), comm)
    assert caught.value.key == "contact.on"


def test_a_group_partly_inside_the_body_keeps_its_boundary_with_a_warning(
    comm: MPI.Intracomm, tmp_path: Path
) -> None:
    named: Groups = {**BODY, "bottom": [(1, 2), (1, 3)]}
    facts = check(study(shared(comm, tmp_path, SQUARE, named)), comm)
    (warning,) = facts["warnings"]
    assert "'bottom' is boundary in part only: line 2 at (0.5, 0.5)" in warning
    (bottom,) = [group for group in facts["groups"] if group.name == "bottom"]
    assert bottom.measure == pytest.approx(1.0)


def test_a_facet_that_is_there_twice_counts_once(comm: MPI.Intracomm, tmp_path: Path) -> None:
    named: Groups = {**BODY, "bottom": [(1, 2), (2, 1)]}
    facts = check(study(shared(comm, tmp_path, SQUARE, named)), comm)
    (bottom,) = [group for group in facts["groups"] if group.name == "bottom"]
    assert bottom.count == 1 and bottom.measure == pytest.approx(1.0)


def test_a_crack_is_a_warning(comm: MPI.Intracomm, tmp_path: Path) -> None:
    """Two of the four triangles about the middle have a node of their own on the left."""
    points = [*SQUARE, (0.5, 0.5), (0, 0.5), (0, 0.5)]
    body = [(1, 2, 5), (2, 3, 5), (3, 4, 5), (1, 5, 6), (7, 5, 4)]
    named: Groups = {"bottom": [(1, 2)], "left": [(1, 6), (7, 4)], "body": body}
    (warning,) = check(study(shared(comm, tmp_path, points, named)), comm)["warnings"]
    assert "the body is cut where nodes are double: nodes 6 and 7 are both at (0, 0.5)" in warning


def test_parts_that_meet_in_a_node_are_parts_with_a_warning(
    comm: MPI.Intracomm, tmp_path: Path
) -> None:
    points = [*SQUARE, (2, 1), (2, 2)]
    named: Groups = {**BODY, "corner": [(3, 5, 6)], "far": [(5, 6)]}
    path = shared(comm, tmp_path, points, named)
    with pytest.raises(InputError, match=r"part 2 of the body \(corner, from \(1, 1\) to \(2, 2\)"):
        check(study(path), comm)
    held = [{"on": ["left", "far"], "value": [0, 0]}]
    facts = check(study(path, loads={"displacements": held}), comm)
    assert "meet in node 3 at (1, 1), and share no edge" in facts["warnings"][0]


def test_a_thin_triangle_is_a_warning(comm: MPI.Intracomm, tmp_path: Path) -> None:
    points, named = [*SQUARE, (0.5, -1e-8)], {**BODY, "body": [*BODY["body"], (1, 2, 5)]}
    domain = from_file(shared(comm, tmp_path, points, named), comm)
    (warning,) = domain.warnings
    assert "triangle 6 at (0.5, -3.33333e-09) has nearly collapsed" in warning


LOOSE: Groups = {**BODY, "island": [(5, 6, 7)], "shore": [(5, 6)], "coast": [(6, 7)]}


@pytest.mark.parametrize("contact", ["bottom", ["bottom", "shore"]])
def test_a_part_that_nothing_holds_is_named_with_its_place(
    contact: Any, comm: MPI.Intracomm, tmp_path: Path
) -> None:
    path = shared(comm, tmp_path, SQUARE + FAR, LOOSE)
    with pytest.raises(InputError) as caught:
        check(study(path, contact={"on": contact}), comm)
    message = str(caught.value)
    assert "part 2 of the body (island, from (3, 0) to (4, 1)) is loose" in message
    assert caught.value.key == "loads.displacements"


def test_parts_that_are_held_one_by_one_are_solved(comm: MPI.Intracomm, tmp_path: Path) -> None:
    path = shared(comm, tmp_path, SQUARE + FAR, LOOSE)
    held = [{"on": "left", "value": [0, -0.01]}, {"on": "coast", "value": [0, 0]}]
    facts = check(study(path, loads={"displacements": held}), comm)
    assert facts["held by"] == {
        "part 1 of the body (body, from (0, 0) to (1, 1))": "displacements on left",
        "part 2 of the body (island, from (3, 0) to (4, 1))": "displacements on coast",
    }
    assert solve(study(path, loads={"displacements": held}), comm).converged


def test_contact_holds_a_part_that_is_pressed_onto_it(comm: MPI.Intracomm, tmp_path: Path) -> None:
    path = shared(comm, tmp_path, SQUARE + FAR, LOOSE)
    loads = {
        "displacements": [{"on": "left", "value": [0, 0]}, {"on": "coast", "value": [0, None]}],
        "body_force": [0, -0.01],
    }
    contact = {"on": ["bottom", "shore"]}
    facts = check(study(path, loads=loads, contact=contact), comm)
    held = list(facts["held by"].values())
    assert held == ["displacements on left", "displacements on coast and contact on shore"]


@pytest.mark.parametrize(("dim", "h"), [(2, 0.25), (3, 0.5)])
def test_a_file_gives_the_same_domain_as_the_builder_that_wrote_it(
    dim: int, h: float, comm: MPI.Intracomm, tmp_path: Path
) -> None:
    block = builder("block", dim=dim, h=h)
    path = Path(comm.bcast(str(tmp_path))) / "block.msh"
    if comm.rank == 0:
        write(block, path)
    comm.Barrier()
    one, two = from_geometry(block, comm), from_file(path, comm)
    assert (one.facet_names, one.cell_names) == (two.facet_names, two.cell_names)
    assert not two.warnings and two.part_names == ("the body",)
    assert two.mesh.geometry.x == pytest.approx(one.mesh.geometry.x, abs=1e-12)
    for name in one.facet_names:
        assert np.array_equal(one.facets([name]), two.facets([name]))


def test_numbers_of_nodes_may_have_gaps(comm: MPI.Intracomm, tmp_path: Path) -> None:
    """Such numbers stay in a file after nodes were removed."""
    path = Path(comm.bcast(str(tmp_path))) / "body.msh"
    if comm.rank == 0:
        path.write_text(msh(SQUARE, BODY, [54321, 7, 700, 3]))
    comm.Barrier()
    (body,) = [group for group in groups(from_file(path, comm)) if group.dim == 2]
    assert body.count == 2 and body.measure == pytest.approx(1.0)


def groups_of(comm: MPI.Intracomm, name: str, **given: Any) -> dict[str, Group]:
    return {group.name: group for group in groups(from_geometry(builder(name, **given), comm))}


def test_groups_have_measure_and_normal(comm: MPI.Intracomm) -> None:
    found = groups_of(comm, "block", dim=3, h=0.5)
    assert found["body"].measure == pytest.approx(1.0) and found["body"].facing() == ""
    facing = {"left": "(-1, 0, 0)", "back": "(0, 1, 0)", "bottom": "(0, 0, -1)"}
    for name, normal in facing.items():
        assert found[name].facing() == normal and found[name].measure == pytest.approx(1.0)
    assert groups_of(comm, "annulus", h=0.3)["inner"].facing() == "all ways (closed)"
    quarter = groups_of(comm, "annulus", h=0.1, quarter=True)
    assert quarter["outer"].facing() == "(0.637, 0.637) (curved)"  # 2/pi


def test_large_numbers_of_nodes_are_compared_as_small_ones() -> None:
    """Three numbers above 2^21 do not fit into one of 64 bits."""
    rows = np.random.default_rng(1).integers(0, 50, (2000, 3))
    small, large = topology.keys(rows, 50), topology.keys(rows, 2**40)
    for ours in (small, large):
        _, inverse = np.unique(ours, return_inverse=True)
        assert np.array_equal(inverse, np.unique(rows, axis=0, return_inverse=True)[1].ravel())


@pytest.mark.serial
@pytest.mark.parametrize("cut", [0.3, 0.5, 0.7, 0.9, 0.97])
@pytest.mark.parametrize("version", ["2.2", "4.1"])
def test_a_file_without_its_end_is_refused(version: str, cut: float, tmp_path: Path) -> None:
    path = tmp_path / "body.msh"
    if version == "2.2":
        write_msh(path, *side_by_side(4, 4, gap=0.1))
    else:
        write(BUILDERS["block"](h=0.25), path)
    text = path.read_text()
    path.write_text(text[: int(cut * len(text))])
    with pytest.raises(InputError, match=r"body\.msh") as caught:
        from_file(path, MPI.COMM_SELF)
    assert caught.value.key == "mesh.file"


@pytest.mark.serial
@pytest.mark.parametrize(
    ("program", "expected"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", r"it crashed \(SIGSEGV\)"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "for want of memory"),
        ("raise SystemExit(134)", "ended with exit code 134"),
        ("import nowhere", "No module named 'nowhere'"),
    ],
)
def test_a_crash_of_gmsh_is_told(
    program: str,
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = write_msh(tmp_path / "body.msh", SQUARE, BODY)
    (tmp_path / "crashes.py").write_text(program)
    monkeypatch.setattr(reader, "_PROGRAM", "crashes")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(InputError, match=rf"Gmsh cannot read .*body\.msh: .*{expected}"):
        reader.read(path)
    (tmp_path / "study.yml").write_text("mesh: {file: body.msh}\n")
    assert cli.main(["check", str(tmp_path / "study.yml")]) == 2
    assert str(path) in capsys.readouterr().err


@pytest.mark.serial
def test_a_message_of_a_bad_mesh_has_the_line_of_the_study_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_msh(tmp_path / "body.msh", moved(SQUARE, 3, (math.nan, 1)), BODY)
    file = tmp_path / "study.yml"
    file.write_text("title: x\nmesh: {file: body.msh}\n")
    for command in ("check", "run"):
        assert cli.main([command, str(file)]) == 2
        assert f"error: {file}:2: mesh.file: " in capsys.readouterr().err


@pytest.mark.serial
def test_the_process_that_reads_is_none_of_the_launcher(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "7")
    monkeypatch.setenv("PMIX_RANK", "3")
    assert not reader._environment().keys() & {"OMPI_COMM_WORLD_SIZE", "PMIX_RANK"}
    assert len(reader.read(write_msh(tmp_path / "body.msh", SQUARE, BODY)).cells) == 2
