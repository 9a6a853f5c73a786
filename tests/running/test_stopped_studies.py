"""Studies that are killed, interrupted or out of room keep what is finished, and go on."""

from __future__ import annotations

import errno
import shutil
import signal
import sys
from pathlib import Path

import pytest
from slow import slow
from study_folder import Folder, alive, wait_for

from contact_locking.command import cli
from contact_locking.errors import ContactLockingError

pytestmark = pytest.mark.serial


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Folder:
    return Folder(tmp_path, monkeypatch)


def test_the_second_of_two_studies_waits_for_nobody_and_harms_nothing(
    folder: Folder, capsys: pytest.CaptureFixture[str]
) -> None:
    folder.write("{vary: {penalty.n: [10]}}")
    first = folder.start(FAKE_SECONDS="3")
    wait_for(folder.running)
    assert cli.main(["study", str(folder.file), "--output", str(folder.output)]) == 2
    assert f"a study, process {first.pid} on" in capsys.readouterr().err
    assert first.wait(timeout=30) == 0
    assert folder.started() == ["10"]
    assert [row["state"] for row in folder.table()] == ["converged"]


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
        context.setattr("contact_locking.files.atomic.os.replace", replace)
        with pytest.raises(ContactLockingError, match=r"No space left.*\n.*make room"):
            folder.run(jobs=1)
    assert list(folder.output.rglob(".partial-*")) == []
    folder.run()
    assert folder.started() == ["10", "20"]
    assert {row["state"] for row in folder.table()} == {"converged"}
