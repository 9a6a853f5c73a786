"""Studies on a cluster: job arrays, by programs that behave like Slurm's."""

from __future__ import annotations

import os
import signal
import sys
import textwrap
from pathlib import Path

import pytest
from study_folder import Folder, wait_for

from contact_locking.command import cli
from contact_locking.errors import ContactLockingError
from contact_locking.files import ownership
from contact_locking.running.studies import slurm

pytestmark = pytest.mark.serial

SBATCH = """
import os, re, subprocess, sys, time
script = sys.argv[-1]
assert sys.argv[1:-1] == ["--wait", "--parsable"]
if os.environ.get("SBATCH_PARTITION") == "wrong":
    sys.exit("sbatch: error: invalid partition specified: wrong")
print("4711", flush=True)
first, last, jobs = re.search(r"--array=(\\d+)-(\\d+)%(\\d+)", open(script).read()).groups()
for task in map(str, range(int(first), int(last) + 1)):
    if task != os.environ.get("LOST_TASK"):
        subprocess.run(["sh", script], env=os.environ | {"SLURM_ARRAY_TASK_ID": task})
"""

# A cancelled job is completing as often as the file has lines; then Slurm knows it no more.
SQUEUE = """
[ "$1 $2" = "--noheader --jobs=42" ] || exit 2
if [ -s "{0}/completing" ]; then
    sed -i 1d "{0}/completing"
    echo 42 CG
else
    echo "slurm_load_jobs error: Invalid job id specified" >&2
    exit 1
fi
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Folder:
    tools = tmp_path / "slurm's"
    tools.mkdir()
    (tools / "sbatch").write_text(f"#!{sys.executable}\n{textwrap.dedent(SBATCH)}")
    (tools / "scancel").write_text(f'#!/bin/sh\necho "$@" >>"{tmp_path}/cancelled"\n')
    (tools / "squeue").write_text(f"#!/bin/sh\n{SQUEUE.format(tmp_path)}")
    for tool in tools.iterdir():
        tool.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tools}:{os.environ['PATH']}")
    monkeypatch.setattr(slurm.SlurmExecutor, "pause", 0.05)
    monkeypatch.setattr(slurm, "_SETTLING_SECONDS", 0.3)
    return Folder(tmp_path, monkeypatch)


def test_an_array_runs_the_cases_and_a_resume_only_what_has_no_results(folder: Folder) -> None:
    folder.write("{vary: {penalty.n: [3, 9, 10]}}")
    folder.run(executor="slurm")
    assert folder.started() == ["10", "3", "9"]
    states = ["not converged", "failed", "converged"]
    assert [row["state"] for row in folder.table()] == states
    assert folder.table()[1]["reason"] == "was killed by SIGKILL, perhaps for want of memory"
    assert "2 finished before" in folder.run(executor="slurm")
    assert folder.started() == ["9"]


def test_many_cases_are_several_arrays(folder: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slurm, "_LARGEST_ARRAY", 2)
    folder.write("{vary: {penalty.n: [10, 20, 30]}}")
    folder.run(executor="slurm")
    assert {row["state"] for row in folder.table()} == {"converged"}


def test_a_task_that_slurm_ends_is_a_failed_case(
    folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LOST_TASK", "0")
    folder.write("{vary: {penalty.n: [10, 20]}}")
    folder.run(executor="slurm")
    lost, solved = folder.table()
    assert lost["state"] == "failed" and "limit of time or memory" in lost["reason"]
    assert solved["state"] == "converged"


def test_what_sbatch_refuses_is_told(folder: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SBATCH_PARTITION", "wrong")
    folder.write("{vary: {penalty.n: [10]}}")
    with pytest.raises(ContactLockingError, match=r"sbatch takes no job: .* partition"):
        folder.run(executor="slurm")


def test_an_interrupted_study_cancels_its_job(folder: Folder) -> None:
    folder.write("{vary: {penalty.n: [10]}}")
    process = folder.start("--executor", "slurm", FAKE_SECONDS="3")
    wait_for(folder.running)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)
    assert process.returncode == 130
    assert (folder.path / "cancelled").read_text() == "4711\n"
    # The next study waits for the end of this job.
    assert (folder.output / "cases" / slurm.JOB).read_text() == "4711"


def test_the_job_of_a_stopped_study_has_ended_before_the_next_submits(folder: Folder) -> None:
    folder.write("{vary: {penalty.n: [10]}}")
    folder.run()
    job = folder.output / "cases" / slurm.JOB
    ownership.write_text(job, "42")
    completing = folder.path / "completing"
    completing.write_text("\n" * 3)
    folder.write("{vary: {penalty.n: [20]}}")
    folder.run(executor="slurm")
    assert (folder.path / "cancelled").read_text() == "42\n"
    assert completing.read_text() == ""
    assert [row["state"] for row in folder.table()] == ["converged"]
    assert not job.exists()


def test_a_job_that_does_not_end_holds_the_next_up_for_some_time(
    folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(slurm, "_ENDING_SECONDS", 0.2)
    folder.write("{vary: {penalty.n: [10]}}")
    folder.run()
    ownership.write_text(folder.output / "cases" / slurm.JOB, "42")
    completing = folder.path / "completing"
    completing.write_text("\n" * 10_000)
    folder.write("{vary: {penalty.n: [20]}}")
    folder.run(executor="slurm")
    assert completing.read_text() != ""
    assert [row["state"] for row in folder.table()] == ["converged"]


def test_without_sbatch_nothing_is_begun(
    folder: Folder, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    folder.write("{vary: {penalty.n: [10]}}")
    words = ["study", str(folder.file), "--output", str(folder.output), "--executor", "slurm"]
    assert cli.main(words) == 2
    assert "takes sbatch, which is not on the PATH" in capsys.readouterr().err
    assert not folder.output.exists()
