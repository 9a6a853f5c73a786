"""Every mistake people make: one clear message with its place, exit code 2, nothing written."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from typing import Any

import pytest
from block_study import BLOCK, refusal
from changed_study import changed

from contact_locking.command import cli
from contact_locking.errors import InputError
from contact_locking.study_file import from_mapping, load
from contact_locking.study_file.schema import rows

pytestmark = pytest.mark.serial


def nested(key: str, value: Any) -> Any:
    """A mapping with ``value`` at a dotted key, in which 0 is the only entry of a list."""
    for part in reversed(key.split(".")):
        value = [value] if part == "0" else {part: value}
    return value


WRONG = [
    ("material.locking_limit", 0),
    ("material.locking_limit", "-2*pi"),
    ("material.locking_limit", "sin(q)"),
    ("material.locking_limit", "s"),
    ("material.elasticity.poisson", 0.5),
    ("material.elasticity.lambda", 1),
    ("material.elasticity", {"lambda": 1, "mu": 0}),
    ("material.elasticity", {"young": 1, "mu": 1}),
    ("material.elasticity.stiffness", [[1, 2], [2, 1]]),
    ("material.elasticity.stiffness", [[1, 0, 0], [0, 1], [0, 0, 1]]),
    ("material.elasticity.stiffness", [[1, 0, 0], [0.5, 1, 0], [0, 0, 1]]),
    ("material.elasticity.stiffness", [[1, 2, 0], [2, 1, 0], [0, 0, 1]]),
    ("material.elasticity.stiffness", [[float(i == j) for i in range(6)] for j in range(6)]),
    ("material.regions.core", {}),
    ("loads.body_force", [1, 2, 3]),
    ("loads.body_force", ["z", 0]),
    ("loads.tractions", [{"on": "top", "value": [1]}]),
    ("loads.tractions", [{"on": "top"}]),
    ("loads.tractions", [{"on": "top", "value": [0, 1]}] * 201),
    ("loads.tractions", [{"on": "topp", "value": [0, 1]}]),
    ("loads.tractions", [{"on": ["top", "top"], "value": [0, 1]}]),
    ("loads.tractions", [{"on": "top", "value": [None, 1]}]),
    ("loads.tractions", [{"on": "top", "value": [0, -1e-200]}]),
    ("loads.displacements", [{"on": "top", "value": [None, None]}]),
    ("output.directory", "d" * 3901),
    ("study", {"vary": {f"k{k}": [1] for k in range(101)}}),
    ("contact.on", "botom"),
    ("contact.gap", math.inf),
    ("contact.gap", "foo(x)"),
    ("contact.foundation", {}),
    (
        "contact.foundation",
        {"sphere": {"centre": [0, 0], "radius": 1}, "cylinder": {"centre": [0, 0], "radius": 1}},
    ),
    ("contact.foundation.sphere", {"centre": [0], "radius": 1}),
    ("contact.foundation.half_space", {"point": [0, 0], "normal": [0, 0]}),
    ("contact.foundation.cylinder", {"centre": [0, 0], "radius": 1, "axis": [0, 1, 0]}),
    ("contact", {"gap": 0.1, "foundation": {"sphere": {"centre": [0, 0], "radius": 1}}}),
    ("friction.coefficient", -0.1),
    ("friction.coefficient", "0.3*t"),
    ("friction.smoothing.kernel", "convolve"),
    ("penalty.n", 0),
    ("penalty.n", math.nan),
    ("penalty.n", "many"),
    ("penalty.n", None),
    ("penalty.epsilon", math.inf),
    ("solver.max_iterations", 1.5),
    ("solver.max_iterations", 10**400),
    ("steps", {"to": 1}),
    ("penalty.n", 1e-200),
    ("solver.petsc", {"ksp_type": ["cg"]}),
    ("title", 2024),
    ("mesh.builder", "bloc"),
    ("mesh.size", [1, 1, 1]),
    ("mesh.geometry", {}),
    ("mesh", {"builder": "block", "file": __file__}),
    ("mesh", {"h": 0.1, "file": __file__}),
    ("mesh.file", "none.msh"),
    ("mesh", {"builder": "annulus", "outer": 2}),
    ("contact", {"gap": 0, "1": None}),
    ("locking_limit", 1),
    ("contact.foundation", {"plane": 1}),
    ("mesh.builder", "rectangle"),
    ("mesh.element_size", 0.1),
    ("contact.foundation", {"polyline": [[1, 0]]}),
    ("material.plasticity", {"yield_stress": 1}),
    ("contact.tied", True),
    ("contact.adhesion", 1),
    ("large_strain", True),
    ("material.regions.body.limit", 1),
]


STUDIES_WRONG = [
    {},
    {"vary": {"penalti.n": [1]}},
    {"vary": {"study.vary": [1]}},
    {"vary": {"penalty.n.x": [1]}},
    {"vary": {"loads.tractions.first": [1]}},
    {"vary": {"penalty.n": 1}},
    {"vary": {"penalty.n": [math.nan]}},
    {"vary": {"penalty.n": {"geometric": [1, 10]}}},
    {"vary": {"penalty.n": {"geometric": [0, 10, 3]}}},
    {"vary": {"penalty.n": {"linear": [0, 10, 2.5]}}},
    {"vary": {"penalty.n": {"quadratic": [1, 10, 3]}}},
    {"vary": {"penalty.n": [1]}, "zip": {"penalty.n": [1]}},
    {"vary": {"mesh": [{}], "mesh.h": [1]}},
    {"zip": {"mesh.h": [1, 2], "penalty.n": [1]}},
    {"vary": {"mesh.h": {"linear": [1, 2, 200]}, "penalty.n": {"linear": [1, 2, 200]}}},
    {"vary": {"penalty.n": [1, -1]}},
    {"vary": {"loads.tractions.0.value": [[0, 1]]}},
    {"vary": {"contact.foundation": [{"sphere": {"center": [0, -1], "radius": 1}}]}},
]


def parts(**new: Any) -> dict[str, Any]:
    return {"mesh": {"parts": {"new": new}}}


def locking(**limit: Any) -> dict[str, Any]:
    return {"mesh": {"dim": 2}, "material": {"locking": [limit]}}


def eigenstrain(**given: Any) -> dict[str, Any]:
    return {"material": {"eigenstrain": given}}


def foundation(shape: dict[str, Any], dim: int = 2) -> dict[str, Any]:
    return {"mesh": {"dim": dim}, "contact": {"foundation": shape}}


def motion(given: Any) -> dict[str, Any]:
    return {"steps": {"to": 1, "count": 2}} | foundation(HALF | {"motion": given})


def turned(section: str, given: dict[str, Any]) -> dict[str, Any]:
    return {"mesh": {"builder": "block", "axisymmetric": True}, section: given}


def stretched(**material: Any) -> dict[str, Any]:
    return {"material": {"plane": "stress"} | material}


def probes(*given: Any) -> dict[str, Any]:
    return {"output": {"probes": list(given)}}


def springs(**given: Any) -> dict[str, Any]:
    return {"loads": {"springs": [{"on": "bottom", "stiffness": 1.0} | given]}}


HALF = {"half_space": {"point": [0, 0], "normal": [0, 1]}}
SPHERE = {"sphere": {"centre": [0, -1], "radius": 1}}
BALL = {"norm": "strain", "at_most": 0.1}
LINE = {"from": [0, 0], "to": [1, 0]}
IDENTITY = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
SECTIONS_WRONG: list[tuple[str, Any]] = [
    ("contact", {"contact": 3}),
    ("contact.0", {"contact": [3]}),
    ("contact.1.on", {"contact": [{}, {"on": "botom"}]}),
    # What only scripts give has no key.
    ("contact.0.at", {"contact": [{"at": "a"}]}),
    ("contact.0.<at>", {"contact": [{"<at>": "a"}]}),
    ("contact.1.gap", {"contact": [{}, {"gap": "z"}]}),
    ("contact.1.gap", {"contact": [{}, {"gap": 1, "foundation": SPHERE}]}),
    ("contact.0.friction.coefficient", {"contact": [{"friction": {"coefficient": -1}}]}),
    ("contact.0", {"contact": {"0": {"gap": 1}}}),
    ("contact", {"contact": [{}] * 101}),
    ("contact.name", {"contact": {"name": ""}}),
    ("contact.name", {"contact": {"name": "a.b"}}),
    ("study", {"contact": [{}], "study": {"vary": {"contact.gap": [0]}}}),
    ("study", {"contact": [{}], "study": {"vary": {"contact.1.gap": [0]}}}),
    ("study.vary.contact.0.0.gap", {"contact": [{}], "study": {"vary": {"contact.0.0.gap": [0]}}}),
    ("contact.foundation.polyline", foundation({"polyline": {"<only>": [[0, 0], [1, 0]]}})),
    ("contact.foundation.polyline", foundation({"polyline": [[0, 0], [1, 0]]}, 3)),
    ("contact.foundation.polyline.1", foundation({"polyline": [[0, 0], [1, 0, 0]]})),
    ("contact.foundation.expression", foundation({"expression": "z"})),
    ("contact.foundation.expression", foundation({"expression": "y*t"})),
    ("contact.foundation.surface", foundation({"surface": __file__}, 2)),
    ("contact.foundation.surface.file", foundation({"surface": {"scale": 2}}, 3)),
    ("contact.foundation.force", foundation(HALF | {"force": [0, 0]})),
    ("contact.foundation.force", foundation(HALF | {"force": [0, 0, -1]})),
    ("contact.foundation.motion", motion([0, 0, 0])),
    ("contact.foundation.motion.1", motion([0, "x"])),
    ("contact.foundation.motion", motion({})),
    ("contact.foundation.motion.about", motion({"rotation": "t"})),
    ("contact.foundation.motion.rotation", motion({"rotation": [0, 0, "t"], "about": [0, 0]})),
    ("mesh.parts.new", parts()),
    ("mesh.parts.new.facing", parts(facing=[0, 0])),
    ("mesh.parts.new.box", parts(box=[[1, 0], [0, 1]])),
    ("mesh.parts.new.box.0", parts(box=[[0, 0, 0], [1, 1]])),
    ("mesh.parts.new.expression", parts(expression="x + 1")),
    ("mesh.parts.new.expression", parts(expression="z < 1")),
    ("mesh.parts.new.on", parts(on="botom")),
    ("mesh.parts.new.plane.normal", parts(plane={"point": [0, 0], "normal": [0, 0]})),
    ("mesh.axisymmetric", {"mesh": {"builder": "ball", "axisymmetric": True}}),
    ("mesh.axisymmetric", {"mesh": {"builder": "block", "dim": 3, "axisymmetric": True}}),
    ("mesh.quarter", {"mesh": {"builder": "annulus", "axisymmetric": True}}),
    ("material.plane", turned("material", {"plane": "stress"})),
    ("material.elasticity.stiffness", turned("material", {"elasticity": {"stiffness": IDENTITY}})),
    (
        "material.locking.0.along",
        turned("material", {"locking": [{"norm": "direction", "along": [1], "at_most": 1}]}),
    ),
    (
        "contact.foundation.cylinder",
        turned("contact", {"foundation": {"cylinder": {"centre": [0, -1], "radius": 1}}}),
    ),
    ("contact.foundation.motion.0", turned("contact", {"foundation": HALF | {"motion": [0.1, 0]}})),
    ("material.locking.0", locking(norm="volume")),
    ("material.locking.0.at_most", locking(norm="deviator")),
    ("material.locking.0.at_least", locking(norm="volume", at_least=0.001)),
    ("material.locking.0.at_least", locking(norm="strain", at_most=1, at_least=-1)),
    ("material.locking.0.along", locking(norm="direction", at_most=1)),
    ("material.locking.0.along", locking(norm="direction", along=[0, 0], at_most=1)),
    ("material.locking.0.along", locking(norm="volume", along=[1, 0], at_most=1)),
    ("material.locking.0.matrix", locking(norm="weighted", at_most=1)),
    ("material.locking.0.matrix", locking(norm="weighted", matrix=[[0] * 3] * 3, at_most=1)),
    ("material.locking", {"material": {"locking": [BALL, BALL]}}),
    ("material.locking", {"material": {"locking": [BALL], "locking_limit": 0.2}}),
    ("material.locking.0.norm", stretched(locking=[{"norm": "volume", "at_most": 0.1}])),
    ("material.elasticity.stiffness", stretched(elasticity={"stiffness": IDENTITY})),
    ("material.elasticity.lambda", stretched(elasticity={"lambda": -0.7, "mu": 1.0})),
    ("material.plane", stretched() | {"mesh": {"dim": 3}}),
    ("material.eigenstrain", eigenstrain()),
    ("material.eigenstrain", eigenstrain(value=1.0, expansion=1.0)),
    ("material.eigenstrain.temperature", eigenstrain(value=0.1, temperature=3.0)),
    ("material.eigenstrain.temperature", eigenstrain(expansion=1e-5)),
    ("material.eigenstrain.value.1.0", eigenstrain(value=[[0.1, 0.2], [0.3, 0.1]])),
    ("material.eigenstrain.value", eigenstrain(value=[[0.1, 0.2], 0.3])),
    ("material.eigenstrain.value", eigenstrain(value=[[0.1, 0.2, 0.0]] * 2)),
    ("material.eigenstrain.value.0.2", eigenstrain(value=[[1, 0, 1], [0, 1, 0], [1, 0, 1]])),
    ("material.eigenstrain.value", eigenstrain(value=[0.1])),
    ("material.eigenstrain.on", eigenstrain(value=0.1, on="core")),
    ("material.eigenstrain.value", eigenstrain(value="0.1*t")),
    ("loads.springs.0.along", springs(along=[1])),
    ("output.probes.0", probes({})),
    ("output.probes.0.line.to", probes({"line": {"from": [0, 0], "to": [1, 0, 0], "count": 3}})),
    ("output.probes", probes(*[{"line": LINE | {"count": 9000}}] * 2)),
]


@pytest.mark.parametrize("key", [row.key for row in rows()])
def test_a_value_of_another_kind_and_an_unknown_key_are_refused_by_every_key(key: str) -> None:
    key = key.replace("INDEX", "0").replace("NAME", "new")
    builders = {row.key: row.builders for row in rows()}
    for wrong, value in ((key, [[{"nonsense": {}}]]), (f"{key}x", 1)):
        data = nested(wrong, value)
        if builders.get(key):
            data["mesh"]["builder"] = builders[key][0]
        with pytest.raises(InputError) as caught:
            from_mapping(data)
        # Of an elasticity or a limit the keys that are missing may be named.
        names = (wrong, key.rpartition(".")[0] or key)
        assert any(line.startswith(names) for line in str(caught.value).split("\n"))


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
    assert "is no file" in refusal(path, "mesh: {file: folder}\n")


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
