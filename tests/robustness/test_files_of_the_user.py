"""Results replace those of an earlier run alone; damaged ones are refused by a report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from report_folder import quick, run_folder, study_folder
from solutions import made_up

from contact_locking.command import cli
from contact_locking.errors import InputError
from contact_locking.process.checkpoint import SavedSteps
from contact_locking.running import run as writing
from contact_locking.view import report

pytestmark = pytest.mark.serial

STUDY = """\
mesh: {builder: block, h: 0.5}
contact: {on: bottom}
output: {directory: ., picture: false, fields: false}
study: {vary: {friction.coefficient: [0.1, 0.2]}}
"""
USERS = ("checkpoint/model.pt", "picture.png", "fields.vtkhdf", "summary.json", ".lock")


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
    monkeypatch.setattr("contact_locking.running.solving.solve", never)
    Path("study.yml").write_text(STUDY)
    mine = users(tmp_path / name)
    before = sorted(tmp_path.rglob("*"))
    assert cli.main(["run", "study.yml"]) == 2
    told = capsys.readouterr().err
    assert Path(name).parts[0] in told and "move it away" in told
    assert mine.read_text() == "years of work\n" and sorted(tmp_path.rglob("*")) == before
    if name != ".lock":  # which a check does not take
        assert cli.main(["check", "study.yml"]) == 2
        assert Path(name).parts[0] in capsys.readouterr().err


def test_what_is_put_beside_results_stays(tmp_path: Path) -> None:
    writing.write(made_up(), tmp_path)
    mine = users(tmp_path / "notes.txt")
    writing.write(made_up(output={"picture": False}), tmp_path)
    assert mine.exists() and not (tmp_path / "picture.png").exists()


def test_a_saved_state_replaces_no_folder_of_the_user(tmp_path: Path) -> None:
    mine = users(tmp_path / "checkpoint" / "model.pt")
    with pytest.raises(InputError, match="checkpoint: was not written") as caught:
        writing.save(made_up(), tmp_path)
    assert caught.value.key == "output.directory" and mine.exists()


def test_a_folder_of_saved_steps_is_removed_but_for_what_is_the_users(tmp_path: Path) -> None:
    SavedSteps(tmp_path).prepare("fingerprint")
    (tmp_path / "steps" / "000001").mkdir()
    (tmp_path / "steps" / "000001" / "record.json").write_text("{}")
    mine = users(tmp_path / "steps" / "notes.txt")
    SavedSteps(tmp_path).remove()
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [mine]
    mine.unlink()
    SavedSteps(tmp_path).remove()
    assert not mine.parent.exists()


@pytest.mark.parametrize("name", ["table.csv", "parameters.yaml"])
def test_a_study_refuses_a_folder_with_a_file_of_the_user(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("contact_locking.running.runner._solve", never)
    Path("study.yml").write_text(STUDY)
    mine = users(tmp_path / name)
    assert cli.main(["study", "study.yml"]) == 2
    assert mine.name in capsys.readouterr().err
    assert mine.read_text() == "years of work\n"


@pytest.mark.usefixtures("unrendered")
def test_the_reports_of_a_run_and_a_study_in_one_folder_are_two_pages(tmp_path: Path) -> None:
    run_folder(tmp_path)
    study_folder(tmp_path)
    pages = report.write(tmp_path)
    assert pages == [tmp_path / "report.html", tmp_path / "report-study.html"]
    run, study = (page.read_text(encoding="utf-8") for page in pages)
    assert "of 8 cases" not in run and "cases" in study and run != study


CONTACT = (
    "x,y,u_normal,u_tangent_x,u_tangent_y,gap,pressure,traction_tangent_x,traction_tangent_y,"
    "bound,state,normal_x,normal_y,contact\n1,2,0,0,0,0,0,0,0,0,open,0,-1,0\n"
)
DAMAGE = {
    "no summary": ("summary.json", None),
    "half a summary": ("summary.json", '{"converged": tr'),
    "deep summary": ("summary.json", "[" * 100_000),
    "other version": ("summary.json", '{"version": "0.0.1", "converged": true}'),
    "no UTF-8": ("summary.json", b"\xff\xfe"),
    "no contact": ("contact.csv", None),
    "empty contact": ("contact.csv", ""),
    "strange contact": ("contact.csv", "a,b\n1,2\n"),
    "no number": ("contact.csv", CONTACT.replace("\n1,", "\nx,")),
    "half a contact": ("contact.csv", CONTACT.replace(",0\n", ",1.5\n")),
    "no facets": ("contact_facets.csv", None),
    "strange facet": ("contact_facets.csv", "point_0,point_1\n0,99\n"),
    "no parameters": ("parameters.yaml", None),
}


@pytest.mark.parametrize("what", DAMAGE)
def test_a_damaged_run_is_refused_in_words(
    what: str, own_run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, content = DAMAGE[what]
    file = own_run / name
    file.unlink()
    if content is not None:
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert cli.main(["report", str(own_run)]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ") and "Traceback" not in said
    assert not (own_run / report.PAGE).exists()


@pytest.mark.parametrize(
    "table",
    [
        "",
        "[]\n",
        '{"state": "not run"}\n',
        '{"state": "converged", "version": "9"}\n',
    ],
)
def test_a_damaged_study_is_refused_in_words(table: str, tmp_path: Path) -> None:
    study_folder(tmp_path)
    (tmp_path / "table.jsonl").write_text(table)
    with pytest.raises(InputError):
        report.write(tmp_path)


def test_a_folder_without_results_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    for name in ("", "file", "no"):
        assert cli.main(["report", str(tmp_path / name)]) == 2
        assert str(tmp_path / name) in capsys.readouterr().err


@quick
def test_a_folder_that_cannot_be_written_to_is_refused(
    own_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: Any, **kwargs: Any) -> str:
        raise PermissionError(13, "Permission denied", str(own_run))

    monkeypatch.setattr("tempfile.mkdtemp", refuse)
    with pytest.raises(InputError, match=r"no report can be written in .*Permission denied"):
        report.write(own_run)
    assert not (own_run / report.PAGE).exists()
