"""Study files: YAML as it may be, overrides, and the way back to YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from block_study import BLOCK
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import all_of, block, sheared

from contact_locking import solve_steps
from contact_locking.errors import InputError
from contact_locking.process.loop import Timeline
from contact_locking.results.table import Table
from contact_locking.solver.settings import Steps
from contact_locking.study_file import dump, from_mapping, load
from contact_locking.study_file.parameters.wording import REMOVED_KEYS, REMOVED_VALUES

pytestmark = pytest.mark.serial

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


def test_a_dump_loads_back_to_equal_parameters(file: Path, tmp_path: Path) -> None:
    mesh = tmp_path / "body.msh"
    mesh.touch()
    for overrides in (
        [],
        ["material.elasticity={lambda: 1, mu: 1 + x}", "material.locking_limit=.inf"],
        ["material.regions={body: {locking_limit: .inf}}", "title='# 1e4: ü\\t'"],
        ["mesh={file: body.msh}", "penalty.epsilon=1e-6", "penalty.n=.inf"],
        ["mesh={dim: 3}", "loads={body_force: [0, z, 1e-90]}", "contact={gap: x**2}"],
        ["contact.on=[]", "contact.foundation={sphere: {centre: [0, -1/3], radius: 1e6}}"],
        ["solver.petsc={pc_type: 'on', a: 'null', b: 1, c: true, d: 1.5e-8, e: '07'}"],
        ["study={zip: {mesh.h: {geometric: [0.1, 0.2, 3]}, title: [a, '2', 'null']}}"],
    ):
        parameters = load(file, overrides).parameters
        again = tmp_path / "again.yml"
        again.write_text(dump(parameters))
        assert load(again).parameters == parameters


@settings(max_examples=30, deadline=None)
@given(TITLE, TEXT)
def test_any_text_survives_a_dump(folder: Path, title: str, option: str) -> None:
    parameters = from_mapping({"title": title, "solver": {"petsc": {"prefix": option}}})
    path = folder / "again.yml"
    path.write_text(dump(parameters), encoding="utf-8")
    assert load(path).parameters == parameters


def test_names_that_look_like_numbers_stay_as_they_are_written(tmp_path: Path) -> None:
    (tmp_path / "body.msh").touch()
    file = tmp_path / "a.yml"
    names = ["01", "1e3", "1_0", "true", "null", "2024-1-2"]
    regions = ", ".join(f"{name}: {{}}" for name in names)
    file.write_text(f"mesh: {{file: body.msh}}\nmaterial: {{regions: {{{regions}}}}}\n")
    assert list(load(file).parameters.material.regions) == names


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
    assert [part.data for part in parameters.loads.tractions[0].value] == [0.0, -1.0]
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
        ("penalty.n=[1", "--set penalty.n: is not valid YAML"),
        ("penalty.n=&a 1\n--- 2", "--set penalty.n: is not valid YAML"),
        ("penalty.n.m=1", "--set penalty.n.m: 'penalty.n' is a value"),
        ("loads.tractions.1.value=[0, 1]", "indices 0 to 0, not '1'"),
        ("loads.tractions.x.value=[0, 1]", "indices 0 to 0, not 'x'"),
    ],
)
def test_a_wrong_override_is_refused_by_its_key(file: Path, override: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        load(file, [override])
    assert message in str(caught.value)


def test_results_go_to_a_folder_with_the_name_of_the_file(tmp_path: Path) -> None:
    for name in ("base", "other"):
        (tmp_path / f"{name}.yml").write_text("contact: {on: bottom}\noutput:\n")
        parameters = load(tmp_path / f"{name}.yml").parameters
        assert parameters.output.directory == f"results/{name}"
        elsewhere = load(tmp_path / f"{name}.yml", ["output.directory=out"]).parameters
        assert elsewhere.output.directory == "out"


def test_the_key_on_is_read_as_programs_of_yaml_1_1_write_it(tmp_path: Path) -> None:
    (tmp_path / "study.yml").write_text("contact:\n  true: left\n")
    assert load(tmp_path / "study.yml").parameters.contacts[0].on == ("left",)
    data = {"contact": {True: "left"}, "loads": {"tractions": [{True: "top", "value": [0, 1]}]}}
    parameters = from_mapping(data)
    assert parameters.contacts[0].on == ("left",)
    assert parameters.loads.tractions[0].on == ("top",)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("adapt.by", "bound"),
        ("certificate.bound_meshes", 4),
        ("friction.coefficient", float("inf")),
        ("friction.smoothing.at_supports", "vanish"),
        ("contact.foundation.tilt", {"about": [0.0, 0.0]}),
        ("material.limits_of", "elastic"),
        ("mesh.curved", True),
        ("output.animation", True),
        ("output.formats", ["vtx"]),
        ("solver.friction", "nested"),
        ("discretisation.limit_at", "gauss"),
        ("mesh.facets", "facets.xdmf"),
    ],
)
def test_what_has_gone_is_refused_by_its_key_with_what_to_do_instead(key: str, value: Any) -> None:
    *path, last = key.split(".")
    data: dict[str, Any] = {"contact": {"on": "bottom"}}
    section = data
    for name in path:
        section = section.setdefault(name, {})
    section[last] = value
    with pytest.raises(InputError) as caught:
        from_mapping(data)
    message = str(caught.value)
    advice = REMOVED_KEYS.get(key) or REMOVED_KEYS.get(last) or REMOVED_VALUES[last, str(value)]
    assert key in message and advice in message


def test_a_norm_that_has_gone_is_refused_by_its_key() -> None:
    limit = {"norm": "largest_principal", "at_most": 0.01}
    with pytest.raises(InputError, match=r"material\.locking\.0\.norm") as caught:
        from_mapping({"material": {"locking": [limit]}})
    assert REMOVED_VALUES["norm", "largest_principal"] in str(caught.value)


def test_the_time_is_refused_without_steps() -> None:
    with pytest.raises(ValueError, match="depends on the time t, and the file has no steps"):
        block(contact__gap="0.1*t")
    loads = {"displacements": [{"on": "left", "value": ["t", 0]}]}
    with pytest.raises(ValueError, match=r"steps: \{to: 1, count: 20\}"):
        block(loads=loads)
    with pytest.raises(ValueError, match="unknown name 't'"):
        block(material__locking_limit="0.02*t", steps={"to": 1, "count": 2})


def test_steps_that_make_no_sense_are_refused() -> None:
    for to, times in ((1, [1]), (None, []), (None, [0, 1, 1])):
        with pytest.raises(InputError) as caught:
            Steps(to=to, times=times)
        assert caught.value.key == "Steps.times"
    with pytest.raises(InputError, match="give `to` and `count`"):
        Steps(to=1)


def test_a_value_that_is_not_finite_at_some_time_is_refused_with_its_key() -> None:
    loads = {"displacements": [{"on": "top", "value": [0, "-0.01/(1 - t)"]}]}
    with pytest.raises(InputError, match="finite") as caught:
        list(solve_steps(sheared(2, loads=loads)))
    assert caught.value.key == "loads.displacements.0.value.1"


def test_a_timeline_reaches_every_planned_time_whatever_fails() -> None:
    random = np.random.default_rng(1)
    for _ in range(50):
        planned = [float(time) for time in np.cumsum(random.uniform(0.01, 1.0, 5))]
        timeline = Timeline(Steps(times=planned))
        most, reached, tries = random.uniform(0.1, 1.0), [], 0
        while not timeline.is_over and tries < 500:
            tries += 1
            length = timeline.target - timeline.done
            if length > most * random.uniform(0.5, 1.0):
                assert timeline.fail()
                continue
            timeline.succeed()
            reached.append(timeline.done)
        assert timeline.is_over and set(planned) <= set(reached) and reached == sorted(reached)


def test_a_history_is_read_as_it_was_written() -> None:
    history = all_of(sheared(2))[-1].history
    again = Table.read(history.text(), "history.csv")
    assert again == history and again.columns == history.columns
    with pytest.raises(InputError, match=r"history\.csv:2"):
        Table.read(history.text().replace("\n1,", "\n1,1,"), "history.csv")
