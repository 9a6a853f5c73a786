"""Study files that are refused: in one readable message, whatever is in them."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import pytest
from block_study import BLOCK, refusal

from contact_locking.errors import InputError
from contact_locking.study_file import from_mapping, load

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
    ("", "FILE: is empty"),
    ("# nothing\n", "FILE: is empty"),
    ("- 1\n", "FILE:1: must be a mapping"),
    ("text", "FILE:1: must be a mapping"),
    (b"title: \xff\n", "FILE:1: is not text in UTF-8"),
    ("a: 1\nb: [1, 2\n", "is not valid YAML"),
    ("a:\n\t- 1\n", "indented by blanks, not by tabs"),
    ("mesh: {h: 1\nloads: {}\n", "while parsing a flow mapping that begins in line 1"),
    ("mesh: {h:0.5}\n", "a blank is missing after the colon: 'h: 0.5'"),
    ("mesh: {h: 0,5}\n", "a decimal point, not a comma"),
    ("material: {M: 0.02}\n", "did you mean 'material.locking_limit'?"),
    ("material: {young: 1}\n", "did you mean 'material.elasticity.young'?"),
    ("material: {elasticity: {young: 210 GPa}}\n", "a number has no unit"),
    ("loads: {tractions: {on: top, value: [0, 1]}}\n", "entries that begin with '- '"),
    ("penalty: {n: 1.0e2000}\n", "FILE:1: '1.0e2000' is too large; infinity is written .inf"),
    ("penalty:\n  n: -1.0e2000\n", "FILE:2: '-1.0e2000' is too large"),
    ("title: \x07\n", "is not valid YAML"),
    ("penalty: {n: 1}\npenalty: {n: 2}\n", "FILE:2: penalty: is given twice"),
    ("penalty:\n  n: 1\n  n: 2\n", "FILE:3: penalty.n: is given twice"),
    ("mesh: &m {h: 1}\nloads: *m\n", "anchors and aliases"),
    ("a: &a [*a]\n", "anchors and aliases"),
    ("<<: {h: 1}\n", "merging"),
    ("title: !!python/object:os.system x\n", "tags such as"),
    ("title: !mine x\n", "tags such as"),
    ("loads: !!set {a, b}\n", "tags such as"),
    ("{[1]: 2}\n", "a key must be a name"),
    ("title: " + "[" * 60 + "]" * 60, "nested"),
    ("title: " + "[" * 500 + "]" * 500, "nested"),
    ("a: 1\n---\nb: 2\n", "is not valid YAML"),
    ("penalty: {n: " + "9" * 5000 + "}\n", "cannot be read as int"),
    ("x" * 300_001, "larger than 300 kB"),
    ('title: "\\uD800"\n', "escape"),
]


@pytest.mark.parametrize(("content", "message"), UNREADABLE, ids=lambda c: repr(c)[:20])
def test_what_is_no_study_file_is_refused(
    tmp_path: Path, content: str | bytes, message: str
) -> None:
    text = refusal(tmp_path / "a.yml", content)
    assert message in text
    assert "\n" not in text
    assert text.startswith("FILE")


@pytest.mark.parametrize("title", [299_900 * "x", 100_000 * "\u00e9"], ids=["long", "escaped"])
def test_a_file_whose_dump_could_not_be_read_again_is_refused(
    file: Path, tmp_path: Path, title: str
) -> None:
    text = refusal(tmp_path / "a.yml", f"title: {title}")
    assert text == "FILE: with every default written out, is larger than 300 kB"
    assert load(tmp_path / "a.yml", ["title=short"]).parameters.title == "short"
    with pytest.raises(InputError, match="every default written out"):
        load(file, [f"title={title}"])


def test_aliases_cannot_blow_up_a_file(tmp_path: Path) -> None:
    levels = [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 12)]
    start = time.perf_counter()
    assert "anchors" in refusal(tmp_path / "a.yml", "\n".join(["a0: &a0 [x]", *levels]))
    assert time.perf_counter() - start < 2


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


def test_a_mesh_file_whose_name_no_file_can_have_is_not_there(tmp_path: Path) -> None:
    assert "control character" in refusal(tmp_path / "a.yml", 'mesh: {file: "a\\0b"}\n')
    for name in ("a" * 300, "a/" * 5000):
        text = refusal(tmp_path / "a.yml", f"mesh: {{file: {name}}}\n")
        assert text.startswith("FILE:1: mesh.file: there is no such file:") and len(text) < 1100


def test_a_message_stays_readable_whatever_is_in_the_file(tmp_path: Path) -> None:
    lines = refusal(tmp_path / "a.yml", "".join(f"key_{k}: 1\n" for k in range(1000))).split("\n")
    assert len(lines) == 21 and lines[19].startswith("FILE:20: key_19: unknown key")
    assert lines[20] == "FILE: there may be more that is wrong; these are the first 20 faults"
    assert len(refusal(tmp_path / "a.yml", f"{'k' * 900}: 1\n")) < 500


def test_what_a_terminal_would_obey_is_shown_as_an_escape(tmp_path: Path) -> None:
    on = "\\0\\e[2J"
    text = f'loads: {{tractions: [{{on: "{on}", value: [0, 1]}}]}}'
    assert r"no part of the boundary is named '\x00\x1b[2J'" in refusal(tmp_path / "a.yml", text)


def test_a_study_of_copies_of_a_huge_file_is_refused(tmp_path: Path) -> None:
    petsc = ", ".join(f"o{k}: 1" for k in range(1000))
    text = (
        f"solver: {{petsc: {{{petsc}}}}}\nstudy: {{vary: {{mesh.h: {{linear: [1, 2, 2000]}}}}}}\n"
    )
    assert "2000 cases of 1003 values each" in refusal(tmp_path / "a.yml", text)


def test_text_that_is_no_unicode_is_refused_from_python_too() -> None:
    supports = [{"on": on, "value": [0, 0]} for on in ("left", "\ud800")]
    refused: dict[str, dict[str, Any]] = {
        "title": {"title": "\ud800"},
        "contact.on": {"contact": {"on": "\ud800"}},
        "loads.displacements.1.on": {"loads": {"displacements": supports}},
    }
    for key, data in refused.items():
        with pytest.raises(InputError, match=rf"{key}.*: .*no character"):
            from_mapping(data)
