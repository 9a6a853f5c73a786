"""The command run with checkpoints: what it saves and starts from, never in the way of results."""

from __future__ import annotations

from pathlib import Path

import pytest
from mpi4py import MPI
from saved_block import on_rank_0, parameters

from contact_locking import study_file
from contact_locking.command import cli


@pytest.fixture
def folder(comm: MPI.Intracomm, tmp_path: Path) -> Path:
    """One folder for all ranks."""
    return comm.bcast(tmp_path)


class Run:
    """The command line on one study file in one folder."""

    def __init__(self, folder: Path, comm: MPI.Intracomm) -> None:
        self.folder, self._comm = folder, comm
        text = study_file.dump(parameters())
        on_rank_0(comm, lambda: (folder / "study.yml").write_text(text, encoding="utf-8"))

    def __call__(self, name: str, *words: str) -> int:
        words = (*words, "--output", str(self.folder / name))
        code = cli.main(["run", str(self.folder / "study.yml"), *words])
        self._comm.Barrier()
        return code

    def names(self, name: str) -> set[str]:
        found = {path.name for path in (self.folder / name).iterdir()}
        self._comm.Barrier()
        return found


@pytest.fixture
def run(folder: Path, comm: MPI.Intracomm) -> Run:
    return Run(folder, comm)


RESULTS = {
    "summary.json",
    "parameters.yaml",
    "contact.csv",
    "contact_facets.csv",
}


def test_run_saves_a_checkpoint_if_asked_and_says_what_a_restart_did(
    run: Run, comm: MPI.Intracomm, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("a", "--quiet", "--checkpoint") == 0
    assert run.names("a") == RESULTS | {"checkpoint"}
    start = ("--restart", str(run.folder / "a"))
    for changes, told in (
        ((), "meets every criterion, nothing was left to do"),
        (("--set", "friction.coefficient=0.31"), f"from the state in {run.folder / 'a'}\n"),
        (("--set", "penalty.n=1e5"), f"from the state in {run.folder / 'a'}\n"),
    ):
        assert run("b", *start, *changes) == 0
        output = capsys.readouterr().out
        assert (told in output) == (comm.rank == 0)
    # No file of an earlier run stays in the folder.
    assert run("a", "--quiet") == 0
    assert run.names("a") == RESULTS


def test_run_keeps_the_checkpoint_that_it_starts_from(
    run: Run, comm: MPI.Intracomm, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("a", "--quiet", "--checkpoint") == 0
    start = ("--quiet", "--restart", str(run.folder / "a"))
    assert run("a", *start) == 2
    assert ("add --checkpoint" in capsys.readouterr().err) == (comm.rank == 0)
    assert run("a", *start, "--checkpoint", "--set", "friction.coefficient=0.1") == 0
    assert run.names("a") == RESULTS | {"checkpoint"}


def test_bad_restarts_return_2_with_one_message_and_leave_no_trace(
    run: Run, comm: MPI.Intracomm, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("b", "--restart", str(run.folder / "nowhere"), "--quiet") == 2
    errors = capsys.readouterr().err
    assert not (run.folder / "b").exists()
    if comm.rank == 0:
        assert errors.startswith("error: there is no checkpoint in") and errors.count("error") == 1
