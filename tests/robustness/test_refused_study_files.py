"""Study files that are refused: in one readable message, whatever is in them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from block_study import BLOCK, refusal

from contact_locking.errors import InputError
from contact_locking.study_file import load

pytestmark = pytest.mark.serial


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "block.yml"
    path.write_text(BLOCK)
    return path


def test_every_fault_is_reported_with_its_line_in_order(tmp_path: Path) -> None:
    text = BLOCK.replace("n: 1.0e4", "n: -1").replace("h: 0.05", "hh: 1").replace("title", "titel")
    text = text.replace("value: [0.03, -0.05]", "value: 7")
    lines = refusal(tmp_path / "a.yml", text).splitlines()
    assert [line.partition(": ")[0] for line in lines] == ["FILE:1", "FILE:6", "FILE:12", "FILE:23"]
    assert lines[0].startswith("FILE:1: titel: unknown key (did you mean 'title'?)")
    assert lines[1].startswith("FILE:6: mesh.hh: unknown key (did you mean 'h'?)")
    assert lines[2] == "FILE:12: loads.tractions.0.value: must be a list in [ ], not 7"
    assert lines[3] == "FILE:23: penalty.n: must be > 0, not -1"


def test_later_errors_get_their_place(file: Path) -> None:
    study = load(file, ["contact.on=[bottom]"])
    explained = study.explain(InputError("no such group", key="loads.displacements.0.on"))
    assert explained == f"{file}:14: loads.displacements.0.on: no such group"
    deeper = study.explain(InputError("is bad", key="material.elasticity.young.x"))
    assert deeper == f"{file}:8: material.elasticity.young.x: is bad"
    overridden = study.explain(InputError("no such group", key="contact.on"))
    assert overridden == "--set contact.on: no such group"
    default = study.explain(InputError("too small", key="friction.smoothing.other"))
    assert default == f"{file}:21: friction.smoothing.other: too small"
    assert study.explain(InputError("anything")) == "anything"


UNREADABLE = [
    "",
    "# nothing\n",
    "- 1\n",
    "text",
    b"title: \xff\n",
    "a: 1\nb: [1, 2\n",
    "a:\n\t- 1\n",
    "mesh: {h: 1\nloads: {}\n",
    "mesh: {h:0.5}\n",
    "mesh: {h: 0,5}\n",
    "material: {M: 0.02}\n",
    "material: {young: 1}\n",
    "material: {elasticity: {young: 210 GPa}}\n",
    "loads: {tractions: {on: top, value: [0, 1]}}\n",
    "penalty: {n: 1.0e2000}\n",
    "penalty:\n  n: -1.0e2000\n",
    "title: \x07\n",
    "penalty: {n: 1}\npenalty: {n: 2}\n",
    "penalty:\n  n: 1\n  n: 2\n",
    "mesh: &m {h: 1}\nloads: *m\n",
    "a: &a [*a]\n",
    "<<: {h: 1}\n",
    "title: !!python/object:os.system x\n",
    "title: !mine x\n",
    "loads: !!set {a, b}\n",
    "{[1]: 2}\n",
    "title: " + "[" * 60 + "]" * 60,
    "title: " + "[" * 500 + "]" * 500,
    "a: 1\n---\nb: 2\n",
    "penalty: {n: " + "9" * 5000 + "}\n",
    "x" * 300_001,
    'title: "\\uD800"\n',
]


@pytest.mark.parametrize("content", UNREADABLE, ids=lambda content: repr(content)[:20])
def test_what_is_no_study_file_is_refused(tmp_path: Path, content: str | bytes) -> None:
    text = refusal(tmp_path / "a.yml", content)
    assert "\n" not in text
    assert text.startswith("FILE")


def test_a_path_that_is_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no such file"):
        load(tmp_path / "none.yml")
    (tmp_path / "foot.yml").touch()
    with pytest.raises(InputError, match=r"no such file \(did you mean 'foot.yml'\?\)"):
        load(tmp_path / "fot.yml")
    with pytest.raises(InputError, match="is a folder"):
        load(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        load("a\0b")
    # Nobody writes to the pipe: reading it would never end.
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(InputError, match="is a pipe or a device"):
            load(path)


def test_a_mesh_file_is_relative_to_the_study_file(tmp_path: Path) -> None:
    path = tmp_path / "a.yml"
    assert refusal(path, "mesh: {file: body.msh}\n").startswith(
        f"FILE:1: mesh.file: there is no such file: {tmp_path / 'body.msh'}"
    )
    (tmp_path / "body.msh").touch()
    assert load(path).parameters.mesh.file == str(tmp_path / "body.msh")
    (tmp_path / "folder").mkdir()
    assert "is a folder" in refusal(path, "mesh: {file: folder}\n")
