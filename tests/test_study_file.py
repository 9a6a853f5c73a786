"""Study files: YAML as it may be, places in messages, overrides, and the way back to YAML."""

from __future__ import annotations

import copy
import math
import os
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contact_locking.errors import InputError
from contact_locking.parameters import Parameters
from contact_locking.study_file import dump, from_mapping, load
from contact_locking.study_file.source import read

pytestmark = pytest.mark.serial

BLOCK = """\
title: Block pressed and dragged on a rigid foundation
mesh:
  builder: block
  dim: 2
  size: [1.0, 1.0]
  h: 0.05
material:
  elasticity: {young: 1.0, poisson: 0.3}
  locking_limit: 0.02
loads:
  body_force: [0, 0]
  tractions: [{on: top, value: [0.03, -0.05]}]
  displacements:
    - on: left
      value: [0, null]
contact:
  on: bottom
  foundation: {half_space: {point: [0, 0], normal: [0, 1]}}
friction:
  coefficient: 0.3 + 0.1*exp(-s)
  smoothing: {kernel: convolution, radius: 0.1}
penalty:
  n: 1.0e4
  epsilon: null
solver: {method: auto, petsc: {snes_monitor: null}}
study:
  vary: {penalty.n: [1.0e2, 1.0e4, .inf]}
output: {directory: results/block, fields: true, picture: true}
"""


TEXT = st.text(st.characters(codec="utf-8"), max_size=60)
# A title is shown on terminals, for which control characters are commands; options are not.
TITLE = st.text(
    st.characters(codec="utf-8", exclude_categories=["Cc"], include_characters="\n\t"), max_size=60
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """For property tests, whose examples share it."""
    return tmp_path_factory.mktemp("studies")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "block.yml"
    path.write_text(BLOCK)
    return path


def refusal(path: Path, content: str | bytes, *overrides: str) -> str:
    """The message with which the content is refused, the file's path shortened to FILE."""
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(InputError) as caught:
        load(path, overrides)
    return str(caught.value).replace(str(path), "FILE")


def test_the_block_of_the_specification_is_read(file: Path) -> None:
    parameters = load(file).parameters
    assert parameters.mesh.geometry.h == 0.05
    assert parameters.loads.displacements[0].value == (0.0, None)
    assert parameters.friction.coefficient == "0.3 + 0.1*exp(-s)"
    assert parameters.solver.petsc == {"snes_monitor": None}
    assert parameters.study is not None
    assert len(parameters.study.cases()) == 3


def test_a_dump_loads_back_to_equal_parameters(file: Path, tmp_path: Path) -> None:
    mesh = tmp_path / "body.msh"
    mesh.touch()
    for overrides in (
        [],
        ["material.elasticity={lambda: 1, mu: 1 + x}", "material.locking_limit=.inf"],
        ["material.regions={body: {locking_limit: .inf}}", "title='# 1e4: ü\\t'"],
        ["mesh={file: body.msh}", "penalty.epsilon=1e-6", "penalty.n=.inf"],
        ["mesh={dim: 3}", "loads={body_force: [0, z, 1e-300]}", "contact={gap: x**2}"],
        ["contact.on=[]", "contact.foundation={sphere: {centre: [0, -1/3], radius: 1e6}}"],
        ["solver.petsc={pc_type: 'on', a: 'null', b: 1, c: true, d: 1.5e-8, e: '07'}"],
        ["study={zip: {mesh.h: {geometric: [0.1, 0.2, 3]}, title: [a, '2', 'null']}}"],
    ):
        parameters = load(file, overrides).parameters
        again = tmp_path / "again.yml"
        again.write_text(dump(parameters))
        assert load(again).parameters == parameters


@settings(deadline=None)
@given(TITLE, TEXT)
def test_any_text_survives_a_dump(folder: Path, title: str, option: str) -> None:
    parameters = from_mapping({"title": title, "solver": {"petsc": {"prefix": option}}})
    path = folder / "again.yml"
    path.write_text(dump(parameters), encoding="utf-8")
    assert load(path).parameters == parameters


@pytest.mark.parametrize("text", ["1e4", "1.0e4", "1e+4", "10000", "1E4", "'1e4'", "1_0000"])
def test_numbers_as_people_write_them(file: Path, text: str) -> None:
    assert load(file, [f"penalty.n={text}"]).parameters.penalty.n == 1e4


def test_names_that_look_like_numbers_stay_as_they_are_written(tmp_path: Path) -> None:
    (tmp_path / "body.msh").touch()
    file = tmp_path / "a.yml"
    names = ["01", "1e3", "1_0", "true", "null", "2024-1-2"]
    regions = ", ".join(f"{name}: {{}}" for name in names)
    file.write_text(f"mesh: {{file: body.msh}}\nmaterial: {{regions: {{{regions}}}}}\n")
    assert list(load(file).parameters.material.regions) == names


@pytest.mark.parametrize("text", [".inf", ".Inf", "+.inf", "inf"])
def test_infinity(file: Path, text: str) -> None:
    assert load(file, [f"penalty.n={text}"]).parameters.penalty.n == math.inf


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
    for name in ("a" * 300, "a/" * 5000, '"a\\0b"'):
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
    for data in ({"title": "\ud800"}, {"contact": {"on": "\ud800"}}):
        with pytest.raises(InputError, match=r"no character"):
            from_mapping(data)


def test_overrides_replace_and_add(file: Path) -> None:
    overrides = [
        "loads.tractions.0.value=[0, -1]",
        "material.regions.body.locking_limit=0.5",
        "contact={on: bottom}",
        "title=",
        "solver.linear=direct",
        "output.directory=a=b",
    ]
    with pytest.raises(InputError, match="--set title: must be text"):
        load(file, overrides)
    overrides[3] = "title=new"
    parameters = load(file, overrides).parameters
    assert parameters.loads.tractions[0].value == (0.0, -1.0)
    assert parameters.material.regions["body"].locking_limit == 0.5
    assert parameters.contacts[0].foundation is None
    assert parameters.title == "new"
    assert parameters.solver.linear == "direct"
    assert parameters.output.directory == "a=b"


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("penalty.n", "--set penalty.n: must be of the form dotted.key=value"),
        ("=1", "must be of the form"),
        ("penalty..n=1", "must be of the form"),
        ("penalty.n=-1", "--set penalty.n: must be > 0"),
        ("penalty={n: -1}", "--set penalty: penalty.n: must be > 0"),
        ("penalty.m=1", "--set penalty.m: unknown key"),
        ("penalti.n=1", "--set penalti.n: penalti: unknown key (did you mean 'penalty'?)"),
        ("penalty.n=[1", "--set penalty.n: is not valid YAML"),
        ("penalty.n=&a 1\n--- 2", "--set penalty.n: is not valid YAML"),
        ("penalty.n.m=1", "--set penalty.n.m: 'penalty.n' is a value"),
        ("loads.tractions.1.value=[0, 1]", "indices 0 to 0, not '1'"),
        ("loads.tractions.x.value=[0, 1]", "indices 0 to 0, not 'x'"),
        ("mesh.size=[1, 1, 1]", "--set mesh.size: must be a list of 2 numbers"),
        ("contact.foundation.sphere={centre: [0, 0], radius: 1}", "exactly one of"),
    ],
)
def test_a_wrong_override_is_refused_by_its_key(file: Path, override: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        load(file, [override])
    assert message in str(caught.value)


KEYS = (
    "title mesh builder dim size h material elasticity young stiffness locking_limit regions loads",
    "tractions displacements on value contact gap foundation sphere centre radius friction zip",
    "coefficient smoothing kernel penalty n epsilon solver petsc study vary output directory",
    "block geometric linear left top bottom body x*y s z penalty.n .inf 1e4 nan",
)
WORDS = st.sampled_from(" ".join(KEYS).split())
SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), WORDS, st.text(max_size=5)
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(WORDS, inner, max_size=4),
    max_leaves=6,
)


def _containers(data: Any) -> list[Any]:
    if not isinstance(data, dict | list):
        return []
    below = data.values() if isinstance(data, dict) else data
    return [data, *(inner for item in below for inner in _containers(item))]


def _accepted_or_refused(data: Any) -> None:
    try:
        assert isinstance(from_mapping(data), Parameters)
    except InputError as error:
        assert str(error)


@pytest.fixture(scope="module")
def block_data(folder: Path) -> Any:
    path = folder / "block.yml"
    path.write_text(BLOCK)
    return read(path).data


@settings(max_examples=400, deadline=None)
@given(st.data())
def test_mutated_data_are_accepted_or_refused(block_data: Any, data: st.DataObject) -> None:
    mutated = copy.deepcopy(block_data)
    if data.draw(st.booleans()):
        wall = {"on": "right", "gap": 0.1, "friction": {"smoothing": {"radius": 0.2}}}
        mutated["contact"] = [mutated["contact"], wall]
    for _ in range(data.draw(st.integers(1, 3))):
        spot = data.draw(st.sampled_from(_containers(mutated)))
        keys = list(spot) if isinstance(spot, dict) else list(range(len(spot)))
        if isinstance(spot, dict) and (not keys or data.draw(st.booleans())):
            spot[data.draw(WORDS)] = data.draw(VALUES)
        elif not keys:
            spot.append(data.draw(VALUES))
        else:
            spot[data.draw(st.sampled_from(keys))] = data.draw(VALUES)
    _accepted_or_refused(mutated)


@settings(max_examples=150, deadline=None)
@given(
    st.integers(0, len(BLOCK)),
    st.integers(0, 6),
    st.text("\"'&*!|>%@`{}[],:#?-\n\t x0.~<=\\\0é", max_size=6),
)
def test_mutated_text_is_accepted_or_refused(
    folder: Path, start: int, removed: int, inserted: str
) -> None:
    path = folder / "mutated.yml"
    path.write_text(BLOCK[:start] + inserted + BLOCK[start + removed :])
    try:
        load(path)
    except InputError as error:
        assert str(path) in str(error)
