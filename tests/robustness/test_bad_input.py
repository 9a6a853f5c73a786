"""Every mistake people make: one clear message with its place, exit code 2, nothing written."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import pytest
from block_study import BLOCK, refusal
from changed_study import changed
from wrong_values import SECTIONS_WRONG, STUDIES_WRONG, WRONG, nested

from contact_locking.command import cli
from contact_locking.errors import InputError
from contact_locking.study_file import from_mapping, load

pytestmark = pytest.mark.serial


def _refused(file: Path, output: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """Run the file, assert that it is refused cleanly, and return the message."""
    code = cli.main(["run", str(file), "--output", str(output)])
    captured = capsys.readouterr()
    assert code == 2, captured.err
    assert captured.err.startswith("error: ")
    assert "Traceback" not in captured.err
    return captured.err


STIFFNESS = [[2.0, 0.5, 0.0], [0.5, 2.0, 0.0], [0.0, 0.0, 1.0]]

CASES: list[tuple[dict[str, Any], str]] = [
    ({"loads.tractions": [{"on": "up", "value": [0, 1]}]}, "loads.tractions.0.on"),
    ({"material.regions": {"core": {"locking_limit": 1.0}}}, "material.regions"),
    ({"loads.displacements": [], "friction.coefficient": 0}, "loads.displacements"),
    ({"loads.displacements": [{"on": ["left", "bottom"], "value": [0, 0]}]}, "loads.displacements"),
    ({"material.locking_limit": "x - 0.5"}, "material.locking_limit"),
    ({"friction.coefficient": "0.5 - x"}, " friction.coefficient: "),
    ({"loads.body_force": ["__import__('os').system('true')", 0]}, "loads.body_force.0"),
    ({"contact.gap": "log(x - 2)"}, "contact.gap"),
    ({"contact": [{"on": "bottom", "gap": "log(x - 2)"}]}, "contact.0.gap"),
    (
        {"contact": [{"on": "bottom", "friction": {"coefficient": "0.3 - x"}}]},
        "contact.0.friction.coefficient",
    ),
    ({"contact": [{"on": "bottom"}, {"on": "wall"}]}, "contact.1.on"),
    (
        {"material.elasticity": {"stiffness": [["2 - 4*x", *STIFFNESS[0][1:]], *STIFFNESS[1:]]}},
        "material.elasticity",
    ),
    (
        {"contact.foundation": {"half_space": {"point": [0, 0], "normal": [0, -1]}}},
        "contact.foundation",
    ),
    (
        {"contact.foundation": {"sphere": {"centre": [0, -1e308], "radius": 1e308}}},
        "contact.foundation.sphere.radius",
    ),
    (
        {"loads.tractions": [{"on": "top", "value": [0, "sqrt(x - 0.5)"]}]},
        "loads.tractions.0.value.1",
    ),
    (
        {"mesh.h": 0.2, "loads.tractions": [{"on": "top", "value": [0, "1/(x - 0.5)"]}]},
        "loads.tractions.0.value.1",
    ),
    ({"loads.body_force": ["log(y - 0.5)", 0]}, "loads.body_force.0"),
    (
        {"loads.tractions": [{"on": "top", "value": [0, "exp(1000*x)"]}]},
        "loads.tractions.0.value.1",
    ),
    ({"material.elasticity": {"young": 1e-300, "poisson": 0.3}}, "material.elasticity"),
    ({"material.locking_limit": "1e-200*x"}, "material.locking_limit"),
]


@pytest.mark.parametrize(("changes", "key"), CASES)
def test_bad_data_are_refused_with_their_key(
    changes: dict[str, Any], key: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = changed(tmp_path, changes)
    message = _refused(file, tmp_path / "out", capsys)
    assert f"{file}:" in message and key in message, "the message names the file, line and key"
    assert not list((tmp_path / "out").glob("*")), "nothing is written"


def test_results_of_an_earlier_run_survive_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "out"
    output.mkdir()
    (output / "summary.json").write_text("precious")
    _refused(changed(tmp_path, {"contact.on": "botom"}), output, capsys)
    assert (output / "summary.json").read_text() == "precious"


def test_output_that_is_a_file_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("in the way")
    message = _refused(changed(tmp_path, {}), tmp_path / "out", capsys)
    assert "output.directory" in message
    assert (tmp_path / "out").read_text() == "in the way"


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


@pytest.mark.parametrize(("key", "value"), WRONG)
def test_a_wrong_value_is_refused_with_its_key(key: str, value: Any) -> None:
    with pytest.raises(InputError) as caught:
        from_mapping(nested(key, value))
    text = str(caught.value)
    assert text.startswith(key) or re.match(key.rpartition(".")[0] or key, text)
    assert "\n" not in text
    assert "pydantic" not in text
    assert "Input should" not in text


def test_dimension_of_a_file_is_checked_when_it_is_known() -> None:
    loads = {"tractions": [{"on": "anything", "value": [0, 0, "z"]}]}
    parameters = from_mapping({"mesh": {"file": __file__}, "loads": loads})
    assert parameters.mesh.dim is None
    parameters.check_dimension(3)
    with pytest.raises(InputError, match="2 components in 2D") as caught:
        parameters.check_dimension(2)
    assert caught.value.key == "loads.tractions.0.value"


def test_ellipticity_depends_on_the_dimension() -> None:
    # 2 lambda + 2 mu = 0.2 > 0 but 3 lambda + 2 mu = -0.7 < 0
    elasticity = {"lambda": -0.9, "mu": 1}
    mesh = {"file": __file__}
    parameters = from_mapping({"mesh": mesh, "material": {"elasticity": elasticity}})
    parameters.check_dimension(2)
    with pytest.raises(InputError, match="not elliptic") as caught:
        parameters.check_dimension(3)
    assert caught.value.key == "material.elasticity.lambda"


def test_all_that_is_wrong_is_reported_at_once() -> None:
    with pytest.raises(InputError) as caught:
        from_mapping({"penalty": {"n": 0, "epsilon": -1}, "title": 1, "nonsense": 1})
    assert len(str(caught.value).splitlines()) == 4


@pytest.mark.parametrize("study", STUDIES_WRONG)
def test_a_study_that_cannot_run_is_refused(study: Any) -> None:
    with pytest.raises(InputError) as caught:
        from_mapping({"study": study})
    assert str(caught.value).startswith("study")


@pytest.mark.parametrize(("key", "data"), SECTIONS_WRONG)
def test_a_wrong_section_is_refused_with_its_key_alone(key: str, data: Any) -> None:
    with pytest.raises(InputError) as caught:
        from_mapping(data)
    assert str(caught.value).startswith(f"{key}: ")
    assert "\n" not in str(caught.value)
