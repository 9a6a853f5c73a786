"""A file or a text of somebody else's never runs a program, and never writes a file."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from mpi4py import MPI

from contact_locking import from_mapping
from contact_locking.command import cli, terminal
from contact_locking.command.terminal import TerminalMonitor
from contact_locking.errors import InputError
from contact_locking.mesh.sources import from_file
from contact_locking.plain_text import spreadsheet_cell
from contact_locking.running.runner import PROGRAM

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
    with pytest.raises(InputError, match=r"body\.msh is not a mesh in version") as caught:
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


def test_a_mesh_that_crashes_gmsh_is_refused() -> None:
    Path("body.msh").write_text(MESH.replace("4 0 1 0", "0 0 1 0"))
    with pytest.raises(InputError, match=r"Gmsh cannot read body\.msh"):
        from_file(Path("body.msh"), MPI.COMM_SELF)


@pytest.mark.parametrize("ending", ["geo", "py", "msh.gz", "$(touch ran);`touch ran`.msh.gz"])
def test_the_name_of_the_file_starts_nothing(ending: str) -> None:
    path = Path(f"body.{ending}")
    path.write_text(MESH)
    assert from_file(path, MPI.COMM_SELF).num_cells == 2


def test_options_beside_the_mesh_or_at_home_are_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("body.msh").write_text(MESH)
    monkeypatch.setenv("HOME", os.getcwd())
    for name in ("body.msh.opt", ".gmshrc", ".gmsh-options", "gmshrc", "onelab.db"):
        Path(name).write_text(SCRIPT)
    assert from_file(Path("body.msh"), MPI.COMM_SELF).num_cells == 2


TITLE = r"$\frac{ $\undefined </title><script>run()</script> %s {0} \\input{x} [red]"


def test_a_title_is_no_formula_no_html_and_no_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("body.msh").write_text(MESH.replace('"top"', '"<b>$^{</b>"'))
    Path("study.yml").write_text(
        f"title: '{TITLE}'\n{(STUDY % 'body.msh').replace('[0, 0]', '[0, -0.02]')}"
        "friction: {coefficient: 0, smoothing: {kernel: none}}\noutput: {directory: out}\n"
    )
    assert cli.main(["run", "study.yml"]) == 0
    assert cli.main(["report", "out"]) == 0
    assert Path("out/picture.png").stat().st_size > 1000
    page = Path("out/report.html").read_text(encoding="utf-8")
    assert "<script>run()" not in page and "&lt;script&gt;run()" in page
    assert "\x1b" not in capsys.readouterr().out


@pytest.mark.parametrize("key", ["title", "output.directory"])
@pytest.mark.parametrize("character", ["\x1b", "\x00"])
def test_texts_hold_no_control_characters(key: str, character: str) -> None:
    section, _, name = key.partition(".")
    text = f"a{character}[2J"
    with pytest.raises(InputError, match="a control character"):
        from_mapping({section: {name: text} if name else text})


def test_the_terminal_gets_no_commands(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.complain("error: no \x1b[31mred\nand no \u202etxt.exe")
    assert capsys.readouterr().err == "error: no \\x1b[31mred\n       and no \\u202etxt.exe\n"
    assert terminal.columns([("a\x9b", "b\n\x07")]) == "a\\x9b  b\\n\\x07"
    TerminalMonitor().message("\x1b]0;mine\x07 [red]")
    assert capsys.readouterr().out == "\\x1b]0;mine\\x07 [red]\n"


@pytest.mark.parametrize(
    "text", ["=cmd|'/c calc'!A0", "@SUM(1)", "-1+cmd|'/c calc'!A0", "+2|x!A0", "\t=1", "\r=1"]
)
def test_a_spreadsheet_takes_no_text_for_a_formula(text: str) -> None:
    assert spreadsheet_cell(text) == f"'{text}"


def test_options_of_petsc_in_the_current_folder_are_not_read() -> None:
    for name in (".petscrc", "petscrc"):
        Path(name).write_text("-contact_locking_pc_type python\n-dll_append evil.so\n")
    Path("body.msh").write_text(MESH)
    Path("study.yml").write_text(STUDY % "body.msh")
    script = (
        "from contact_locking.command import cli; cli.main(['check', 'study.yml']); "
        "from petsc4py import PETSc; print(sorted(PETSc.Options().getAll()))"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0 and "dll_append" not in done.stdout
    assert "can be run" in done.stdout


def test_modules_in_the_current_folder_are_not_imported() -> None:
    for name in ("gmsh", "numpy", "scipy", "contact_locking"):
        Path(f"{name}.py").write_text("open('ran', 'w').close()\n")
    Path("body.msh").write_text(MESH)
    assert from_file(Path("body.msh"), MPI.COMM_SELF).num_cells == 2
    done = subprocess.run([*PROGRAM, "--version"], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "contact-locking" in done.stdout
