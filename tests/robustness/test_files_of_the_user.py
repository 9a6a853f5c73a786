"""Results replace and remove what this program has written, and nothing of the user's."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from report_folder import run_folder, study_folder
from slow import slow
from solutions import made_up

from contact_locking import study_file
from contact_locking.command import cli
from contact_locking.errors import InputError
from contact_locking.files import ownership
from contact_locking.files.lock import locked
from contact_locking.running import writing
from contact_locking.running.studies.runner import Study
from contact_locking.view import report

pytestmark = pytest.mark.serial

STUDY = """\
mesh: {builder: block, h: 0.5}
contact: {on: bottom}
output: {directory: ., picture: false, fields: false}
study: {vary: {friction.coefficient: [0.1, 0.2]}}
"""
USERS = (
    *("checkpoint/model.pt", "picture.png", "history.csv", "probes.csv", "animation.gif"),
    *("contact.csv/notes.txt", "fields.bp/data.0", "summary.json", ".lock"),
)


def users(place: Path) -> Path:
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text("years of work\n")
    return place


def never(*arguments: object) -> None:
    raise AssertionError("solved")


@pytest.mark.parametrize("name", USERS)
def test_a_run_refuses_a_folder_with_a_file_of_the_user_before_it_solves(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("contact_locking.process.adaptivity.solve", never)
    Path("study.yml").write_text(STUDY)
    mine = users(tmp_path / name)
    before = sorted(tmp_path.rglob("*"))
    assert cli.main(["run", "study.yml"]) == 2
    told = capsys.readouterr().err
    assert name in told and "move it away" in told
    assert mine.read_text() == "years of work\n" and sorted(tmp_path.rglob("*")) == before
    if name != ".lock":  # which a check does not take
        assert cli.main(["check", "study.yml"]) == 2
        assert name in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda out: (out / "picture.png").write_bytes(b"mine"), "picture.png"),
        (lambda out: users(out / "fields.bp" / "notes.txt"), "fields.bp/notes.txt"),
        slow(lambda out: (out / ownership.LIST).unlink(), "parameters.yaml"),
        slow(lambda out: (out / ownership.LIST).write_text("[]"), ownership.LIST),
    ],
)
def test_what_is_put_beside_or_in_place_of_results_stays(
    change: Callable[[Path], object], name: str, tmp_path: Path
) -> None:
    writing.write(made_up(), tmp_path)
    writing.write(made_up(), tmp_path)
    change(tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    with pytest.raises(InputError, match=name):
        writing.write(made_up(output={"picture": False}), tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


def test_a_list_that_came_from_elsewhere_points_to_nothing_outside(tmp_path: Path) -> None:
    mine, folder = users(tmp_path / "mine.txt"), tmp_path / "steps"
    for name in ("../mine.txt", str(mine)):
        folder.mkdir(exist_ok=True)
        listed = {"program": "contact_locking", "files": {name: None}}
        (folder / ownership.LIST).write_text(json.dumps(listed))
        with pytest.raises(InputError, match="is not the list"):
            ownership.discard(folder)
    assert mine.exists()


def test_a_folder_of_saved_steps_is_removed_but_for_what_is_the_users(tmp_path: Path) -> None:
    steps = tmp_path / "steps"
    steps.mkdir()
    ownership.write_text(steps / "run.json", "{}")
    mine = users(steps / "000001" / "notes.txt")
    ownership.discard(steps)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [mine]
    mine.unlink()
    ownership.discard(steps)
    assert not steps.exists()


@pytest.mark.parametrize(
    "name", ["table.csv", "parameters.yaml", "cases/index.txt", "cases/{case}/log.txt"]
)
def test_a_study_refuses_a_folder_with_a_file_of_the_user(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("contact_locking.running.studies.runner._solve", never)
    Path("study.yml").write_text(STUDY)
    case = Study.of(study_file.load(Path("study.yml"))).cases[1].name
    mine = users(tmp_path / name.format(case=case))
    assert cli.main(["study", "study.yml"]) == 2
    assert mine.name in capsys.readouterr().err
    assert mine.read_text() == "years of work\n"


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize("name", ["report.html", "report/photo.png"])
def test_a_report_refuses_to_replace_a_file_of_the_user(name: str, tmp_path: Path) -> None:
    run_folder(tmp_path)
    mine = users(tmp_path / name)
    with pytest.raises(InputError, match=name):
        report.write(tmp_path)
    run_folder(tmp_path)
    assert mine.read_text() == "years of work\n"


@pytest.mark.usefixtures("unrendered")
def test_the_reports_of_a_run_and_a_study_in_one_folder_are_two_pages(tmp_path: Path) -> None:
    run_folder(tmp_path)
    study_folder(tmp_path)
    pages = report.write(tmp_path)
    assert pages == [tmp_path / "report.html", tmp_path / "report-study.html"]
    run, study = (page.read_text(encoding="utf-8") for page in pages)
    assert "of 8 cases" not in run and "cases" in study and run != study


def test_a_lock_left_by_a_killed_run_is_taken_over(tmp_path: Path) -> None:
    (tmp_path / ".lock").write_text("a study, process 12 on a-machine\n")
    with locked(tmp_path, "run"):
        pass
    assert not (tmp_path / ".lock").exists()
