"""Studies: every case once, one table of all, and what is refused before a case is run."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from study_folder import STUDY, Folder, solved

from contact_locking import meshes, study_file
from contact_locking.command import cli, terminal
from contact_locking.command.cli import parse
from contact_locking.errors import InputError

pytestmark = pytest.mark.serial


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Folder:
    return Folder(tmp_path, monkeypatch)


def test_every_case_is_run_once_and_the_table_begins_with_what_varies(folder: Folder) -> None:
    folder.write("{vary: {penalty.n: [10, .inf]}, zip: {friction.coefficient: [0, 0.5]}}")
    said = folder.run(jobs=1)
    assert "4 cases in" in said and "[4/4] friction.coefficient = 0.5, penalty.n = .inf" in said
    assert folder.started() == ["10", "10", "inf", "inf"]
    rows = folder.table()
    assert list(rows[0])[:4] == ["friction.coefficient", "penalty.n", "case", "state"]
    assert [row["penalty.n"] for row in rows] == ["10", "inf", "10", "inf"]
    first = rows[0]
    assert (first["compliance"], first["contact_force.1"], first["converged"]) == (
        *("0.1", "10.0", "true"),
    )
    assert (first["warnings"], first["duality_gap"], first["bounds.b.bound"]) == (
        *("one; two", "", "inf"),
    )
    lines = (folder.output / "table.jsonl").read_text().splitlines()
    assert [list(json.loads(line)) for line in lines] == [list(first)] * 4
    assert json.loads(lines[1])["penalty.n"] == "inf"
    assert json.loads(lines[1])["duality_gap"] is None


def test_each_case_has_a_folder_that_an_index_names(folder: Folder) -> None:
    folder.write("{vary: {penalty.n: [10, 20]}}")
    folder.run()
    index = (folder.output / "cases" / "index.txt").read_text().splitlines()
    assert [line.partition("  ")[2] for line in index] == ["penalty.n = 10", "penalty.n = 20"]
    for row, line in zip(folder.table(), index, strict=True):
        assert line.startswith(row["case"])
        case = study_file.load(folder.output / "cases" / row["case"] / "parameters.yaml")
        assert case.parameters.penalty.n == float(row["penalty.n"])
        assert case.parameters.study is None


def test_the_table_does_not_depend_on_the_number_of_jobs_or_the_order(folder: Folder) -> None:
    folder.write("{vary: {penalty.n: [10, 3, 9, 20, 30]}}")
    tables = []
    for jobs in (1, 4):
        shutil.rmtree(folder.output, ignore_errors=True)
        folder.run(jobs)
        tables.append([(folder.output / f"table.{kind}").read_bytes() for kind in ("csv", "jsonl")])
    assert tables[0] == tables[1]


def test_a_case_that_fails_is_recorded_with_its_reason_and_the_others_go_on(folder: Folder) -> None:
    folder.write("{vary: {penalty.n: [1, 2, 3, 5, 6, 7, 9, 10]}}")
    folder.run()
    found = {row["penalty.n"]: (row["state"], row["reason"]) for row in folder.table()}
    state, reason = found["1"]
    assert state == "failed" and "exit code 1" in reason and "log.txt" in reason
    assert found["2"] == ("failed", "parameters.yaml:3: contact.on: no part is named so")
    assert found["3"] == ("not converged", "too steep")
    assert found["5"] == ("failed", "was killed by SIGSEGV")
    assert found["6"][0] == "failed" and "crashed: SEGV: Segmentation Violation;" in found["6"][1]
    assert found["7"][0] == "failed" and "no results" in found["7"][1]
    assert found["9"][0] == "failed" and "SIGKILL" in found["9"][1]
    assert found["10"] == ("converged", "every criterion held")
    assert {row["converged"] for row in folder.table()[:-1]} == {"false"}


def test_a_case_of_several_ranks_that_crashes_or_is_killed_is_recorded_too(folder: Folder) -> None:
    if shutil.which("mpirun") is None:
        pytest.skip("mpirun is not installed")
    folder.write("{vary: {penalty.n: [5, 9, 10]}}")
    process = folder.start("--jobs", "3", ranks=2)
    errors = process.communicate(timeout=120)[1]
    assert (process.returncode, errors) == (3, "")
    crashed, killed, well = folder.table()
    assert crashed["reason"].startswith("was killed by SIGSEGV")
    assert killed["reason"].startswith("was killed by SIGKILL")
    assert well["state"] == "converged"


def test_a_resume_repeats_what_failed_without_results_and_nothing_else(folder: Folder) -> None:
    folder.write("{vary: {penalty.n: [3, 9, 10]}}")
    folder.run()
    assert folder.started() == ["10", "3", "9"]
    assert "2 finished before" in folder.run()
    assert folder.started() == ["9"]


def test_a_changed_file_reruns_only_what_changed(folder: Folder) -> None:
    folder.write("{vary: {penalty.n: [10, 20]}}")
    folder.run()
    folder.started()
    text = f"title: A better name\n# and a remark\n{STUDY}".replace("h: 0.5", "h: 5.0e-1")
    folder.write("{zip: {penalty.n: [30, 20.0]}}", text)
    folder.run()
    assert folder.started() == ["30"]
    assert [row["penalty.n"] for row in folder.table()] == ["30", "20.0"]
    assert len(folder.summaries()) == 3


def test_a_mesh_file_counts_with_its_content(folder: Folder) -> None:
    body = folder.path / "body.msh"
    meshes.write(meshes.BUILDERS["block"](h=0.5), body)
    text = STUDY.replace("{builder: block, h: 0.5}", "{file: body.msh}")
    folder.write("{vary: {penalty.n: [10]}}", text)
    folder.run()
    assert folder.started() == ["10"]
    moved = body.rename(folder.path / "moved.msh")
    folder.write("{vary: {penalty.n: [10]}}", text.replace("body.msh", "moved.msh"))
    folder.run()
    assert folder.started() == []
    moved.write_text(f"{moved.read_text()}\n")
    folder.run()
    assert folder.started() == ["10"]


@pytest.mark.parametrize("content", ["", "[]", '{"converged": true}', '{"converged"'])
def test_a_summary_that_is_no_complete_one_of_the_case_does_not_count(
    content: str, folder: Folder
) -> None:
    folder.write("{vary: {penalty.n: [10]}}")
    folder.run()
    (summary,) = folder.summaries()
    summary.write_text(content)
    folder.started()
    folder.run()
    assert folder.started() == ["10"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--output", "/dev/null/out"], "results cannot be written to /dev/null/out"),
        (["--jobs", "0"], "--jobs: must be an integer from 1"),
        (["--ranks", "two"], "--ranks: must be an integer from 1"),
        (["--ranks", "2"], "mpirun, which is not on the PATH"),
        (["--set", "study=null"], "has no study"),
        (["--set", "study={vary: {output.directory: [a, b]}}"], "each case already"),
        (["--set", "study={vary: {penalty.n: [1, -1]}}"], "in the case penalty.n = -1"),
        (["--set", "title=&a [*a]"], "anchors"),
    ],
)
def test_bad_input_is_one_message(
    words: list[str],
    message: str,
    folder: Folder,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder.write("{vary: {penalty.n: [10]}}")
    monkeypatch.setenv("PATH", "/nowhere")
    output = [] if "--output" in words else ["--output", str(folder.output)]
    assert cli.main(["study", str(folder.file), *output, *words]) == 2
    errors = capsys.readouterr().err
    assert errors.startswith("error: ") and message in errors
    assert not folder.output.exists()


def test_cases_run_on_several_ranks(folder: Folder) -> None:
    if shutil.which("mpirun") is None:
        pytest.skip("mpirun is not installed")
    folder.write("{vary: {penalty.n: [100]}}")
    (two,) = solved(folder, "--ranks", "2")
    shutil.rmtree(folder.output)
    (one,) = solved(folder)
    assert (one["ranks"], two["ranks"]) == ("1", "2")
    assert float(two["compliance"]) == pytest.approx(float(one["compliance"]), rel=1e-8)


def test_a_study_is_not_started_under_mpirun(
    folder: Folder, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder.write("{vary: {penalty.n: [10]}}")
    monkeypatch.setattr(terminal, "world", object)
    with pytest.raises(InputError, match="without mpirun: --ranks K"):
        cli._run_command(parse(["study", str(folder.file)]))
