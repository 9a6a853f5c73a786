"""A study in a folder of a test, run with real cases, or with a program that solves nothing."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from contact_locking import study_file
from contact_locking.command import cli
from contact_locking.running.runner import Plan, Study, finish

FAKE = (sys.executable, str(Path(__file__).parent / "fake_case.py"))
STUDY = """\
mesh: {builder: block, h: 0.5}
material: {locking_limit: 0.05}
loads:
  tractions: [{on: top, value: [0.03, -0.05]}]
  displacements: [{on: left, value: [0, 0]}]
contact: {on: bottom}
friction: {smoothing: {radius: 0.6}}
output: {picture: false, fields: false}
"""


class Folder:
    """A study file, its results, and a log of the cases that were run."""

    def __init__(self, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.path = path
        self.file = path / "study.yml"
        self.output = path / "out"
        self.log = path / "runs.log"
        monkeypatch.setenv("FAKE_LOG", str(self.log))

    def write(self, study: str, text: str = STUDY) -> None:
        self.file.write_text(f"{text}study: {study}\n")

    def load(self) -> study_file.StudyFile:
        return study_file.load(self.file, [f"output.directory={self.output}"])

    def run(self, jobs: int = 4) -> str:
        """Run the study with the fake program, and return what is said."""
        lines, file = list[str](), self.load()
        finish(Study.of(file), file.parameters, Plan(jobs, program=FAKE), lines.append)
        return "\n".join(lines)

    def started(self) -> list[str]:
        """penalty.n of all cases that were begun since the last call."""
        if not self.log.exists():
            return []
        lines = self.log.read_text().split()
        self.log.unlink()
        return sorted(lines[1::2])

    def table(self) -> list[dict[str, str]]:
        with (self.output / "table.csv").open(newline="") as stream:
            return list(csv.DictReader(stream))

    def summaries(self) -> list[Path]:
        return sorted(self.output.glob("cases/*/summary.json"))

    def start(self, *words: str, ranks: int = 1, **environment: str) -> subprocess.Popen[str]:
        """The command line as a process of its own, with the fake program."""
        script = f"""
        import functools, sys
        from contact_locking.running import runner
        from contact_locking.command import cli
        runner.Plan = functools.partial(runner.Plan, program={FAKE!r})
        sys.exit(cli.main())
        """
        program = [sys.executable, "-c", textwrap.dedent(script)]
        options = ["--output", str(self.output), "--ranks", str(ranks)]
        return subprocess.Popen(
            [*program, "study", str(self.file), *words, *options],
            env=os.environ | environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def running(self) -> list[int]:
        """The processes of cases that have begun and not ended."""
        begun = self.log.read_text().split()[::2] if self.log.exists() else []
        return [pid for pid in map(int, begun) if alive(pid)]


def solved(folder: Folder, *words: str) -> list[dict[str, str]]:
    """The table of a study with real cases, without the times."""
    assert cli.main(["study", str(folder.file), "--output", str(folder.output), *words]) == 0
    rows = folder.table()
    for row in rows:
        del row["wall_seconds"]
    return rows


def alive(pid: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


def wait_for(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < end, "timed out"
        time.sleep(0.02)
