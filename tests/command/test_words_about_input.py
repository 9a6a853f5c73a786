"""What is said about input and an environment that cannot be used, and what is right instead."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from problems import UNDRAWN_BLOCK

from contact_locking import study_file
from contact_locking.errors import InputError
from contact_locking.expressions import FUNCTIONS, parse
from contact_locking.mesh.file.reader import read
from contact_locking.results.in_words import weakest

pytestmark = pytest.mark.serial

MANUAL = Path(__file__).parents[2] / "docs" / "reference" / "study-file.md"


def refused(tmp_path: Path, text: str, *overrides: str) -> str:
    (tmp_path / "study.yml").write_text(text)
    with pytest.raises(InputError) as caught:
        study_file.load(tmp_path / "study.yml", overrides)
    return str(caught.value)


def test_all_wrong_cases_of_a_study_are_told_at_once(tmp_path: Path) -> None:
    study = "study: {vary: {penalty.n: [-1, 1, -2], friction.coefficient: [0.1, -0.1]}}\n"
    told = refused(tmp_path, UNDRAWN_BLOCK + study).splitlines()
    assert len(told) == 3
    assert "penalty.n = -1, friction.coefficient = 0.1 and 1 other: penalty.n: must be" in told[0]
    assert "friction.coefficient: must be" in told[1] and "and 2 others" in told[1]
    assert "penalty.n = -2" in told[2]


def test_a_study_of_a_body_of_revolution_over_the_degree_needs_no_other_key(tmp_path: Path) -> None:
    text = """
mesh: {builder: block, h: 0.5, axisymmetric: true}
contact: {on: bottom}
study: {vary: {discretisation.degree: [1, 2]}}
"""
    (tmp_path / "study.yml").write_text(text)
    study_file.load(tmp_path / "study.yml")


@pytest.mark.parametrize(
    ("key", "hint"),
    [
        ("loads.tractions.value", "did you mean 'loads.tractions.0.value'?"),
        ("loads.displacements.on", "did you mean 'loads.displacements.0.on'?"),
    ],
)
def test_a_key_of_a_list_without_its_number_is_suggested_with_one(
    key: str, hint: str, tmp_path: Path
) -> None:
    assert hint in refused(tmp_path, f"{UNDRAWN_BLOCK}study: {{vary: {{{key}: [1, 2]}}}}\n")
    assert hint in refused(tmp_path, UNDRAWN_BLOCK, f"{key}=1")


def test_what_expressions_may_use_is_told_and_in_the_manual() -> None:
    with pytest.raises(InputError) as caught:
        parse("t % 2", ("t",))
    assert "no remainder %" in str(caught.value)
    with pytest.raises(InputError) as other:
        parse("[t]", ("t",))
    manual = MANUAL.read_text(encoding="utf-8")
    for name in FUNCTIONS:
        assert name in str(caught.value) and name in str(other.value) and f"`{name}`" in manual


def test_a_pipe_is_no_mesh_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "mesh.msh")
    told = refused(tmp_path, "mesh: {file: mesh.msh}\ncontact: {on: bottom}\n")
    assert "is a pipe or a device" in told and "did you mean" not in told


def test_a_script_of_gmsh_is_refused_with_the_line_that_makes_its_mesh(tmp_path: Path) -> None:
    script = tmp_path / "part.geo"
    script.write_text(
        "Point(1)={0,0,0,0.5};Point(2)={1,0,0,0.5};Point(3)={0,1,0,0.5};"
        "Line(1)={1,2};Line(2)={2,3};Line(3)={3,1};Curve Loop(1)={1,2,3};Plane Surface(1)={1};\n"
    )
    with pytest.raises(InputError, match="a script of Gmsh") as caught:
        read(script)
    line = str(caught.value).partition('python3 -c "')[2].removesuffix('"')
    subprocess.run([sys.executable, "-c", line], check=True, capture_output=True)
    assert read(tmp_path / "part.msh").dim == 2


@pytest.mark.parametrize(("bound", "told"), [(132.8, "no useful bound"), (0.5, "at most 50 %")])
def test_a_bound_above_the_solution_is_no_useful_one(bound: float, told: str) -> None:
    weak = weakest({"certificate": {"errors": {"penalty": {"relative": bound}}}})
    assert weak is not None and told in weak.words


def test_a_home_is_found_and_a_folder_for_temporary_files_asked_for(tmp_path: Path) -> None:
    (tmp_path / "study.yml").write_text(UNDRAWN_BLOCK)
    words = [sys.executable, "-m", "contact_locking", "check", str(tmp_path / "study.yml")]
    without_home = {name: value for name, value in os.environ.items() if name != "HOME"}
    done = subprocess.run(words, capture_output=True, text=True, env=without_home, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    missing = without_home | {"TMPDIR": str(tmp_path / "missing")}
    done = subprocess.run(words, capture_output=True, text=True, env=missing, cwd=tmp_path)
    assert done.returncode == 2 and done.stderr.startswith("error: TMPDIR: ")
