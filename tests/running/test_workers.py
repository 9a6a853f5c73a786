"""Processes that stay: one solves several cases, and a crash concerns the crashed case alone."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest
from study_folder import Folder

from contact_locking.running import executor
from contact_locking.running.executor import Executor, Plan
from contact_locking.running.runner import Study

pytestmark = pytest.mark.serial

# Stands for the worker: ends as n says, and writes its process into the log of each case.
STAND_IN = """
import json, os, re, signal, sys
for line in sys.stdin:
    log, run, file, *_ = json.loads(line)
    n = float(re.search(r"^  n: (.*)", open(file).read(), re.MULTILINE)[1].replace(".inf", "inf"))
    open(log, "a").write(f"process {os.getpid()}\\n")
    if n == 9:
        os.kill(os.getpid(), signal.SIGKILL)
    if n == 5:
        print("error: in words", file=open(log, "a"))
    print(2 if n == 5 else 0, flush=True)
"""


def solve_all(running: Executor) -> dict[str, str]:
    """The reasons of all cases by their values, once all have ended."""
    found = {}
    end = time.monotonic() + 60
    while running.busy:
        assert time.monotonic() < end
        for ended in running.poll():
            found[ended.case.label] = ended.why()
        running.start()
        time.sleep(0.01)
    running.stop()
    return found


def test_a_case_that_crashes_ends_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executor, "_WORKER", (sys.executable, "-c", STAND_IN))
    folder = Folder(tmp_path, monkeypatch)
    folder.write("{vary: {penalty.n: [10, 20, 9, 30, 5, 40]}}")
    cases = Study.of(folder.load()).cases
    reasons = solve_all(Executor(cases, Plan()))
    assert len(reasons) == 6
    assert reasons["penalty.n = 9"].startswith("was killed by SIGKILL")
    assert reasons["penalty.n = 5"] == "in words"
    logs = [(case.folder / "log.txt").read_text().splitlines()[0] for case in cases]
    first, second = logs[0], logs[3]
    assert logs == [first] * 3 + [second] * 3 and first != second


def test_a_process_is_replaced_after_many_cases(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executor, "_WORKER", (sys.executable, "-c", STAND_IN))
    monkeypatch.setattr(executor, "_MOST_CASES", 2)
    folder = Folder(tmp_path, monkeypatch)
    folder.write("{vary: {penalty.n: [10, 20, 30, 40]}}")
    cases = Study.of(folder.load()).cases
    solve_all(Executor(cases, Plan(jobs=1)))
    logs = [(case.folder / "log.txt").read_text() for case in cases]
    assert logs[0] == logs[1] != logs[2] == logs[3]
