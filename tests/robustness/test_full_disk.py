"""Disks that are full or read-only: one message, nothing half-written, and on with it later."""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import h5py
import pytest
from full_disk import NOT_ALLOWED
from PIL import Image
from problems import SMALL_BLOCK
from report_folder import run_folder
from study_folder import FAKE, Folder

pytestmark = pytest.mark.serial

HOLDER = Path(__file__).parents[1] / "support" / "full_disk.py"
slow = pytest.mark.slow


class Disk:
    """A file system of some size at ``path`` while a command runs; then its files are in ``kept``.

    The next command starts with them.
    """

    def __init__(self, folder: Path) -> None:
        self.file = folder / "study.yml"
        self.file.write_text(SMALL_BLOCK)
        self.path, self.kept = folder / "disk", folder / "kept"
        self.path.mkdir()
        self.out = self.path / "out"

    def run(self, size: str, *words: str, script: str = "") -> subprocess.CompletedProcess[str]:
        """``contact-locking WORDS`` with its output on a disk of that size; ``script`` goes first.

        Asserts that it says at most one thing, and that nothing unfinished stays.
        """
        start = f"import sys\nfrom contact_locking.command import cli\n{textwrap.dedent(script)}\n"
        program = [sys.executable, "-c", f"{start}sys.exit(cli.main(sys.argv[1:]))"]
        place = [sys.executable, str(HOLDER), size, str(self.path), str(self.kept)]
        done = subprocess.run(
            [*place, *program, *words], capture_output=True, text=True, timeout=120
        )
        if done.returncode == NOT_ALLOWED:
            pytest.skip(done.stderr.strip())
        assert "Traceback" not in done.stderr and done.stderr.count("error: ") <= 1, done.stderr
        assert not [path for path in self.kept.rglob(".*") if path.name != ".lock"]
        return done

    def solve(self, size: str, *words: str, script: str = "") -> subprocess.CompletedProcess[str]:
        options = ["--quiet", "--output", str(self.out)]
        return self.run(size, "run", str(self.file), *options, *words, script=script)

    @property
    def results(self) -> Path:
        return self.kept / "out"


@pytest.fixture
def disk(tmp_path: Path) -> Disk:
    return Disk(tmp_path)


def complete(folder: Path) -> set[str]:
    """The files of a run, each looked at."""
    assert json.loads((folder / "summary.json").read_text())["converged"]
    assert (folder / "contact.csv").read_text().count("\n") == 6
    with h5py.File(folder / "fields.vtkhdf") as file:
        assert file["VTKHDF/PointData/contact_state"][()].max() >= 1.0
    if (folder / "picture.png").exists():
        with Image.open(folder / "picture.png") as image:
            image.load()
    return {path.name for path in folder.iterdir()}


def full(done: subprocess.CompletedProcess[str], what: str) -> None:
    assert done.returncode == 1
    assert done.stderr.startswith(f"error: {what}") and "No space left on device" in done.stderr
    assert "ake room" in done.stderr and done.stdout == ""


TEXTS = {"summary.json", "parameters.yaml", "contact.csv", "contact_facets.csv"}
FILES = TEXTS | {"fields.vtkhdf"}
DRAWN = FILES | {"picture.png"}


@pytest.mark.slow
def test_a_run_whose_results_have_no_room_leaves_none_and_goes_with_room(disk: Disk) -> None:
    full(disk.solve("48k"), f"results cannot be written to {disk.out}")
    assert not list(disk.kept.glob("out/*"))
    assert disk.solve("10m").returncode == 0
    assert complete(disk.results) == DRAWN


@pytest.mark.slow
def test_earlier_results_survive_a_full_disk(disk: Disk) -> None:
    assert disk.solve("10m").returncode == 0
    before = {path: path.read_bytes() for path in disk.kept.rglob("*") if path.is_file()}
    full(disk.solve("360k", "--set", "penalty.n=50"), "results cannot be written")
    assert {path: path.read_bytes() for path in disk.kept.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("size", ["128k", pytest.param("36k", marks=slow)])
def test_a_checkpoint_that_has_no_room_is_told_by_exit_code_1_and_all_else_is_kept(
    size: str, disk: Disk
) -> None:
    # On the smaller disk another program takes the room while it is written.
    script = "from contact_locking import files\nfiles.require_room = lambda *_: None"
    words = ["--checkpoint", "--set", "output.picture=false", "output.fields=false", "mesh.h=0.05"]
    done = disk.solve(size, *words, script=script if size == "36k" else "")
    assert done.returncode == 1
    assert "No space left on device" in done.stderr
    assert {path.name for path in disk.results.iterdir()} == FILES - {"fields.vtkhdf"}
    assert disk.solve("10m", *words).returncode == 0
    assert (disk.results / "checkpoint" / "record.json").exists()


@slow
def test_all_ranks_are_told_that_there_is_no_room(disk: Disk) -> None:
    mpirun = shutil.which("mpirun")
    if mpirun is None:
        pytest.skip("mpirun is not installed")
    script = f"""
    import os, subprocess
    if "OMPI_COMM_WORLD_SIZE" not in os.environ and "PMI_SIZE" not in os.environ:
        words = [sys.executable, "-m", "contact_locking", *sys.argv[1:]]
        sys.exit(subprocess.run([{mpirun!r}, "-n", "2", *words]).returncode)
    """
    done = disk.solve("96k", script=script)
    assert done.returncode == 1 and "No space left" in done.stderr
    assert not list(disk.kept.iterdir())


@pytest.mark.parametrize("pages", [4, *(pytest.param(k, marks=slow) for k in (2, 6, 8, 10, 12))])
def test_a_study_goes_on_from_wherever_the_disk_was_full(
    pages: int, disk: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A page more lets one file more be written: lock, index, parameters, tables, cases."""
    folder = Folder(disk.file.parent, monkeypatch)
    folder.write("{vary: {penalty.n: [10, 20]}}")
    script = f"""
    import functools
    from contact_locking.running import runner
    runner.Plan = functools.partial(runner.Plan, program={FAKE!r})
    """
    words = ["study", str(folder.file), "--output", str(disk.out)]
    done = disk.run(f"{4 * pages}k", *words, script=script)
    folder.started()
    finished = len(list(disk.kept.glob("out/cases/*/summary.json")))
    if done.returncode == 1:
        assert "No space left on device" in done.stderr
    else:
        assert done.returncode == (0 if finished == 2 else 3) and done.stderr == ""
        assert (disk.results / "table.csv").exists()
    done = disk.run("10m", *words, script=script)
    assert done.returncode == 0, done.stderr
    assert len(folder.started()) == 2 - finished
    table = (disk.results / "table.jsonl").read_text().splitlines()
    assert [json.loads(line)["state"] for line in table] == ["converged"] * 2


@pytest.mark.parametrize("command", ["run", "study", "check", "report", "mesh"])
def test_a_read_only_folder_is_bad_input(command: str, disk: Disk) -> None:
    earlier: dict[str, Any] = {}
    if command == "report":
        run_folder(disk.results)
        earlier = {path.name: path.stat().st_size for path in disk.results.iterdir()}
    options = {
        "check": ["--set", f"output.directory={disk.out}"],
        "mesh": ["-o", str(disk.path / "body.msh")],
        "study": ["--output", str(disk.out), "--set", "study={vary: {penalty.n: [10, 20]}}"],
        "run": ["--output", str(disk.out)],
        "report": [],
    }
    target = str(disk.out if command == "report" else disk.file)
    done = disk.run("ro", command, target, *options[command])
    assert done.returncode == 2, done.stderr
    assert "Read-only file system" in done.stderr and "folder that can be written" in done.stderr
    assert {path.name: path.stat().st_size for path in disk.kept.glob("out/*")} == earlier


def test_a_limit_on_the_size_of_files_is_a_full_disk(tmp_path: Path) -> None:
    """ulimit -f: tried where no file system can be mounted, too."""
    (tmp_path / "study.yml").write_text(SMALL_BLOCK)

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    command = [sys.executable, "-m", "contact_locking", "run", "study.yml", "--quiet"]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=120, preexec_fn=limit
    )
    assert done.returncode == 1
    assert "File too large" in done.stderr and "Make room" in done.stderr
    assert os.listdir(tmp_path) == ["study.yml"]
