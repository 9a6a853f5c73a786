"""The first hour: a study file to begin with, and the schema by which editors check one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from contact_locking import study_file
from contact_locking.command import cli
from contact_locking.meshes import BUILDERS
from contact_locking.study_file import load, schema, schema_text
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.study import known_keys
from contact_locking.study_file.reading import read
from contact_locking.study_file.schema import rows

pytestmark = pytest.mark.serial

DEMOS = Path(__file__).parents[2] / "demos"


@pytest.mark.parametrize("demo", [path.stem for path in DEMOS.glob("*.yml")])
def test_a_new_study_file_has_the_values_of_its_demo(demo: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.yml"
    assert cli.main(["new", "--like", demo, "-o", str(file)]) == 0
    new, old = load(file).parameters, load(DEMOS / f"{demo}.yml").parameters
    assert new.output.directory == "results/mine"
    beside = [path for path in tmp_path.iterdir() if path != file]
    wanted = study_file.dump(old).replace(f"results/{demo}", "results/mine")
    for path in beside:
        wanted = wanted.replace(str(DEMOS / path.name), str(path))
    assert study_file.dump(new) == wanted
    assert f"demos/{demo}" not in file.read_text()


def test_new_writes_a_file_and_overwrites_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new"]) == 0
    assert "contact-locking check study.yml" in capsys.readouterr().out
    before = (tmp_path / "study.yml").read_text()
    assert cli.main(["new", "--like", "hrtz", "-o", "mine.yml"]) == 2
    assert "'hertz'" in capsys.readouterr().err
    assert cli.main(["new", "--like", "hertz"]) == 2
    assert (tmp_path / "study.yml").read_text() == before
    assert cli.main(["new", "--like", "hertz", "-o", "mine.yml"]) == 0
    assert load(tmp_path / "mine.yml").parameters.title == "Cylinder pressed on a rigid plane"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.yml", "study.yml"]


def test_the_table_of_keys_has_every_key_once_below_its_builders() -> None:
    keys = [row.key for row in rows()]
    assert len(keys) == len(set(keys))
    text = schema_text()
    named = [line.split()[0] for line in text.splitlines() if line.startswith("  ")]
    assert all(named.count(key) == 1 for key in keys if "." in key)
    lines = text.splitlines()
    heading = max(i for i in range(lines.index("  of disc:")) if lines[i].startswith("  of "))
    assert "  of every builder:" in lines[: heading + 1]
    assert lines[lines.index("  of annulus, disc_in_ring:") + 1].split()[0] == "mesh.inner_radius"
    assert {name for row in rows() for name in row.builders} == set(BUILDERS)


def problems(data: Any) -> list[str]:
    """What the JSON schema finds wrong with the data of a study file."""
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft7Validator(schema())
    return [error.message for error in validator.iter_errors(data)]


def test_the_json_schema_is_one() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft7Validator.check_schema(json.loads(json.dumps(schema(), allow_nan=False)))


@pytest.mark.parametrize("file", sorted(DEMOS.rglob("*.yml")), ids=lambda file: file.stem)
def test_the_json_schema_accepts_every_demo(file: Path) -> None:
    assert problems(read(file).data) == []


@pytest.mark.parametrize(
    "data",
    [
        {"frction": {"coefficient": 0.3}},
        {"friction": {"coeficient": 0.3}},
        {"mesh": {"builder": "disc", "h_contct": 0.1}},
        {"mesh": {"builder": "disk"}},
        {"mesh": {"builder": "disc", "structured": True}},
        {"loads": {"tractions": [{"on": "top", "valu": [0, 1]}]}},
        {"contact": [{"on": "bottom", "gp": 0}]},
        {"material": {"regions": {"fibre": {"limit": 0.1}}}},
        {"study": {"vary": {"penalty.n": {"geometrical": [1, 10, 3]}}}},
    ],
    ids=str,
)
def test_the_json_schema_refuses_misspelt_keys(data: Any) -> None:
    assert problems(data)


def test_the_json_schema_takes_empty_sections_as_the_program_does(tmp_path: Path) -> None:
    file = tmp_path / "study.yml"
    file.write_text("mesh:\nmaterial:\nfriction:\n  smoothing:\nloads:\n", encoding="utf-8")
    load(file)
    assert problems(read(file).data) == []


def test_the_keys_that_may_vary_are_those_of_sections_and_entries() -> None:
    taken = ["contact", "contact.1.friction.coefficient", "loads.tractions.0.value.1", "mesh.size"]
    taken += ["material.regions.fibre", "material.regions.fibre.elasticity.young"]
    for key in (*taken, "mesh.sizes", "contact.x.gap", "loads.0"):
        assert known(key) == (key in taken), key


def known(key: str) -> bool:
    try:
        known_keys(Parameters, key.split("."))
    except KeyError:
        return False
    return True
