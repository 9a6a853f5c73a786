"""A file or a text of somebody else's never runs a program, and never writes a file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from mpi4py import MPI

from contact_locking import cli
from contact_locking.domain import from_file
from contact_locking.errors import InputError

pytestmark = pytest.mark.serial

MESH = """\
$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
4
1 1 "bottom"
1 2 "top"
1 3 "left"
2 9 "body"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
$EndNodes
$Elements
5
1 1 2 1 1 1 2
2 1 2 2 2 3 4
3 1 2 3 3 4 1
4 2 2 9 9 1 2 3
5 2 2 9 9 1 3 4
$EndElements
"""
STUDY = """\
mesh: {file: "%s"}
material: {elasticity: {young: 1.0, poisson: 0.3}}
loads: {displacements: [{on: left, value: [0, 0]}]}
contact: {on: bottom, gap: 0.01}
"""
SCRIPT = 'SystemCall "touch ran";\n'


@pytest.fixture(autouse=True)
def nothing_has_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Gmsh starts programs in the current folder."""
    monkeypatch.chdir(tmp_path)
    yield
    assert not Path("ran").exists(), "a program was started"


# Gmsh's script in the guise of a mesh.
DISGUISED = {
    "a script": SCRIPT,
    "a script after white space": f"\n  {SCRIPT}",
    "a mesh after a script": SCRIPT + MESH,
    "a mesh after white space, which Gmsh takes for a script": f" {MESH}{SCRIPT}",
    "a byte order mark": f"\ufeff{MESH}{SCRIPT}",
    "a mesh's first word only": f"$MeshFormat; {SCRIPT}",
    "a first line that only begins well": f"$MeshFormats\n{SCRIPT}",
    "a mesh that has no version": f"$MeshFormat\n{SCRIPT}$EndMeshFormat\n",
    "comments before the script": f"$Comments\n$EndComments\n{SCRIPT}",
    "a view": 'View "x" { };\n' + SCRIPT,
    "nothing": "",
}


@pytest.mark.parametrize("guise", DISGUISED)
def test_gmsh_never_sees_what_is_no_mesh(guise: str) -> None:
    Path("body.msh").write_text(DISGUISED[guise], encoding="utf-8")
    with pytest.raises(InputError, match=r"body\.msh is not a mesh in Gmsh's format") as caught:
        from_file(Path("body.msh"), MPI.COMM_SELF)
    assert caught.value.key == "mesh.file"


def test_a_script_is_refused_by_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    Path("body.msh").write_text(SCRIPT)
    Path("study.yml").write_text(STUDY % "body.msh")
    for command in ("check", "run"):
        assert cli.main([command, "study.yml", "--set", "output.directory=out"]) == 2
        assert "study.yml:1: mesh.file: " in capsys.readouterr().err


@pytest.mark.parametrize("place", ["inside", "after"])
def test_a_script_within_a_mesh_is_not_run(place: str) -> None:
    text = MESH + SCRIPT if place == "after" else MESH.replace("$Nodes", f"{SCRIPT}$Nodes", 1)
    Path("body.msh").write_text(text)
    assert from_file(Path("body.msh"), MPI.COMM_SELF).num_cells == 2


@pytest.mark.parametrize("ending", ["geo", "opt", "py", "m", "exe", "pro", "stl", "msh.gz", "step"])
def test_the_ending_of_the_name_does_not_choose_another_reader(ending: str) -> None:
    path = Path(f"body.{ending}")
    path.write_text(MESH)
    assert from_file(path, MPI.COMM_SELF).num_cells == 2


def test_no_shell_sees_the_name_of_the_file() -> None:
    path = Path("body$(touch ran);touch ran;`touch ran`.msh.gz")
    path.write_text(MESH)
    assert from_file(path, MPI.COMM_SELF).num_cells == 2


def test_options_beside_the_mesh_or_at_home_are_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("body.msh").write_text(MESH)
    monkeypatch.setenv("HOME", os.getcwd())
    for name in ("body.msh.opt", ".gmshrc", ".gmsh-options", "gmshrc", "onelab.db"):
        Path(name).write_text(SCRIPT)
    assert from_file(Path("body.msh"), MPI.COMM_SELF).num_cells == 2


def test_versions_that_are_not_known_are_refused() -> None:
    Path("body.msh").write_text(MESH.replace("2.2", "5.0", 1))
    with pytest.raises(InputError, match=r"version 5\.0 of Gmsh's mesh format"):
        from_file(Path("body.msh"), MPI.COMM_SELF)


def test_what_is_no_file_is_refused_at_once() -> None:
    os.mkfifo("pipe.msh")
    Path("folder.msh").mkdir()
    for name in ("pipe.msh", "folder.msh", "/dev/zero"):
        with pytest.raises(InputError, match="is no file"):
            from_file(Path(name), MPI.COMM_SELF)


def test_a_link_to_a_mesh_is_read() -> None:
    Path("body.msh").write_text(MESH)
    Path("link.msh").symlink_to("body.msh")
    assert from_file(Path("link.msh"), MPI.COMM_SELF).num_cells == 2
