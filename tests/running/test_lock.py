"""Folders of results in use: one run or study at a time, and nothing stays of those killed."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest
from problems import SMALL_BLOCK
from slow import slow
from study_folder import Folder, alive, wait_for

from contact_locking.command import cli
from contact_locking.errors import ContactLockingError, InputError
from contact_locking.files import locked

pytestmark = pytest.mark.serial

STUDY = f"{SMALL_BLOCK}output: {{picture: false, fields: false}}\n"


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "study.yml"
    path.write_text(STUDY)
    return path


@pytest.fixture
def running(study: Path) -> Iterator[subprocess.Popen[str]]:
    """A run whose solve does not end, with unfinished files in its folder."""
    script = """
        import sys, time
        from pathlib import Path
        from contact_locking.running import solving
        from contact_locking.command import cli
        from contact_locking.files import staging

        def solve(parameters, *_):
            with staging(Path(parameters.output.directory)) as folder:
                (folder / "fields.vtkhdf").touch()
                time.sleep(60)

        solving.solve = solve
        sys.exit(cli.main())
        """
    words = ["run", str(study), "--output", str(study.parent / "out"), "--quiet"]
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(script), *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_for(lambda: list(study.parent.glob("out/.partial-*/fields.vtkhdf")))
    yield process
    process.kill()
    process.communicate()


def run(study: Path) -> int:
    return cli.main(["run", str(study), "--output", str(study.parent / "out"), "--quiet"])


def test_a_run_in_the_folder_of_a_study_going_on_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Folder(tmp_path, monkeypatch)
    folder.write("{vary: {penalty.n: [10]}}")
    process = folder.start(FAKE_SECONDS="20")
    wait_for(folder.running)
    parameters = (folder.output / "parameters.yaml").read_bytes()
    assert cli.main(["run", str(folder.file), "--output", str(folder.output), "--quiet"]) == 2
    assert f"by a study, process {process.pid} on" in capsys.readouterr().err
    assert (folder.output / "parameters.yaml").read_bytes() == parameters
    assert cli.main(["check", str(folder.file), "--set", f"output.directory={folder.output}"]) == 0
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)


def test_what_a_killed_run_has_left_is_removed_by_the_next(
    study: Path, running: subprocess.Popen[str]
) -> None:
    running.kill()
    running.communicate()
    out = study.parent / "out"
    assert list(out.glob(".partial-*"))
    assert run(study) == 0
    assert not list(out.glob(".*"))


@pytest.mark.parametrize("end", [signal.SIGTERM, slow(signal.SIGHUP), slow(signal.SIGINT)])
def test_a_run_that_a_signal_ends_says_so_and_leaves_nothing(
    end: signal.Signals, study: Path, running: subprocess.Popen[str]
) -> None:
    running.send_signal(end)
    out, errors = running.communicate(timeout=30)
    assert running.returncode == 128 + end
    assert errors == ("interrupted\n" if end == signal.SIGINT else f"stopped by {end.name}\n")
    assert out == ""
    assert [path.name for path in (study.parent / "out").rglob("*") if path.is_file()] == []
    assert not (study.parent / "out" / ".lock").exists()


def test_a_lock_is_held_by_one_and_its_file_goes_with_it(tmp_path: Path) -> None:
    with locked(tmp_path, "run") as held:
        assert held
        with pytest.raises(InputError, match=f"a run, process {os.getpid()} on"):
            locked(tmp_path, "study").__enter__()
    assert list(tmp_path.iterdir()) == []
    # A killed process leaves such a file.
    (tmp_path / ".lock").write_text("a run, process 1 on nowhere\n")
    with locked(tmp_path, "run") as held:
        assert held


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Folder:
    return Folder(tmp_path, monkeypatch)


@pytest.mark.skipif(sys.platform != "linux", reason="processes are tied to their parent on Linux")
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_killed_study_takes_its_cases_along_and_the_next_one_goes_on(
    ranks: int, folder: Folder
) -> None:
    if ranks > 1 and shutil.which("mpirun") is None:
        pytest.skip("mpirun is not installed")
    folder.write("{vary: {penalty.n: [10, 20, 30]}}")
    process = folder.start("--jobs", "2", ranks=ranks, FAKE_SECONDS="60")
    wait_for(lambda: len(folder.running()) == 2 * ranks)
    running = folder.running()
    process.kill()
    process.communicate()
    wait_for(lambda: not any(alive(pid) for pid in running))
    assert folder.summaries() == []
    folder.started()
    folder.run()
    assert folder.started() == ["10", "20", "30"]


@pytest.mark.parametrize("end", [signal.SIGINT, slow(signal.SIGTERM), slow(signal.SIGHUP)])
def test_an_interrupted_study_stops_its_cases_and_says_how_to_go_on(
    end: signal.Signals, folder: Folder
) -> None:
    folder.write("{vary: {penalty.n: [10, 20, 30]}}")
    process = folder.start("--jobs", "2", FAKE_SECONDS="60")
    wait_for(lambda: len(folder.running()) == 2)
    running = folder.running()
    process.send_signal(end)
    output, errors = process.communicate(timeout=30)
    assert process.returncode == 128 + end
    assert not any(alive(pid) for pid in running)
    assert "0 of 3 cases are finished; the same command does the others" in output
    assert errors == ("interrupted\n" if end == signal.SIGINT else f"stopped by {end.name}\n")
    assert {row["state"] for row in folder.table()} == {"not run"}


@pytest.mark.parametrize("room", [0, 3, 5])
def test_a_full_disk_stops_a_study_and_keeps_what_is_finished(
    room: int, folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder.write("{vary: {penalty.n: [10, 20]}}")
    writes = iter(range(room))

    def replace(source: str, target: Path) -> None:
        if next(writes, None) is None:
            raise OSError(errno.ENOSPC, "No space left on device", str(target))
        shutil.move(source, target)

    with monkeypatch.context() as context:
        context.setattr("contact_locking.files.os.replace", replace)
        with pytest.raises(ContactLockingError, match=r"No space left.*\n.*make room"):
            folder.run(jobs=1)
    assert list(folder.output.rglob(".partial-*")) == []
    folder.run()
    assert folder.started() == ["10", "20"]
    assert {row["state"] for row in folder.table()} == {"converged"}
