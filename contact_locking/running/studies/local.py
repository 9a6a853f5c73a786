"""Cases as processes on this machine, each of one rank or of several under mpirun.

Cases of one rank share processes that stay, the workers.  A case that crashes ends its worker, with
the same traces as a process of its own, and the next case gets a new one.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from contact_locking.errors import ContactLockingError

from .cases import LOG, Case, begin
from .executor import Plan, command, environment, explain, words

# mpirun has this time to end its ranks.
_GRACE_SECONDS = 10.0
_PROGRAM = (sys.executable, "-P", "-m", "contact_locking.command.worker")
# A worker is replaced after so many cases, so that no leak of memory adds up.
_MOST_CASES = 100
_PR_SET_PDEATHSIG = 1


class LocalExecutor:
    """Runs J cases at a time.  On Linux they end with this process, in whatever way it ends."""

    pause = 0.05

    def __init__(self, cases: Sequence[Case], plan: Plan) -> None:
        self._plan = plan
        self._environment = environment(plan.jobs, plan.ranks)
        self._waiting = list(reversed(cases))
        self._idle = [Worker(self._environment) for _ in range(plan.jobs * plan.shares_processes)]
        self._working: dict[str, Worker] = {}
        self.running: list[CaseProcess] = []

    @property
    def busy(self) -> bool:
        return bool(self._waiting or self.running)

    def poll(self) -> list[CaseProcess]:
        ended = [process for process in self.running if process.ended()]
        self.running = [process for process in self.running if process not in ended]
        for process in ended:
            if worker := self._working.pop(process.case.name, None):
                self._idle.append(worker)
        while self._waiting and len(self.running) < self._plan.jobs:
            case = self._waiting.pop()
            begin(case)
            self.running.append(self._start(case))
        return ended

    def stop(self) -> None:
        _stop(self.running)
        for worker in self._idle:
            worker.finish()

    def _start(self, case: Case) -> CaseProcess:
        if self._idle:
            worker = self._working[case.name] = self._idle.pop()
            return worker.start(case)
        words = command(case, self._plan.program, self._plan.ranks)
        # A killed mpirun could not end its ranks; SIGTERM makes mpirun end them.
        end = signal.SIGTERM if self._plan.ranks > 1 else signal.SIGKILL
        with (case.folder / LOG).open("wb") as log:
            how = {"stdin": subprocess.DEVNULL, "stdout": log, "stderr": subprocess.STDOUT}
            return CaseProcess(case, _process(words, self._environment, end, **how))


class CaseProcess:
    """A running case with its process."""

    def __init__(self, case: Case, process: subprocess.Popen[bytes]) -> None:
        self.case, self._process, self._began = case, process, time.monotonic()

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._began

    def code(self) -> int | None:
        """The exit code, None before the end of the case."""
        return self._process.poll()

    def ended(self) -> bool:
        return self.code() is not None

    def why(self) -> str:
        code = self.code()
        assert code is not None
        return explain(code, self.case.folder / LOG)

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the process and its children, also after the process has ended."""
        # macOS raises PermissionError for a process that has ended.
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, number)


class WorkerCase(CaseProcess):
    """A case that a worker solves."""

    _answer: int | None = None

    def code(self) -> int | None:
        if self._answer is None:
            # The end is asked for first: an answer may come just before it.
            code = self._process.poll()
            assert self._process.stdout is not None
            answer = self._process.stdout.readline()
            self._answer = int(answer) if answer else code
        return self._answer


class Worker:
    """A process that solves cases; ``finish`` lets it end after its last case."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._environment = environment
        self._process: subprocess.Popen[bytes] | None = None
        self._cases = 0

    def start(self, case: Case) -> WorkerCase:
        """Begin a case, whose folder is prepared. Raises ContactLockingError."""
        process = self._process
        if process is None or process.poll() is not None or self._cases >= _MOST_CASES:
            self.finish()
            how = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
            process = _process(
                _PROGRAM, self._environment, signal.SIGKILL, stderr=subprocess.DEVNULL, **how
            )
            assert process.stdout is not None
            os.set_blocking(process.stdout.fileno(), False)
            self._process, self._cases = process, 0
        self._cases += 1
        log = case.folder / LOG
        log.touch()
        order = json.dumps([str(log), *words(case)])
        assert process.stdin is not None
        # Where the process has just ended, the case ends with the code of the process.
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(f"{order}\n".encode())
            process.stdin.flush()
        return WorkerCase(case, process)

    def finish(self) -> None:
        """Let the process end, which has no case."""
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()
            self._process = None


def _process(
    words: Sequence[str], environment: Mapping[str, str], end: signal.Signals, **streams: Any
) -> subprocess.Popen[bytes]:
    """Start a process that gets the signal ``end`` when this one ends.

    Raises ContactLockingError.  Ctrl-C on the terminal reaches this process only, which then stops
    the cases.
    """
    try:
        return subprocess.Popen(
            words, env=environment, process_group=0, preexec_fn=_tied(end), **streams
        )
    except OSError as error:
        message = f"a case cannot be started: {words[0]}: {error.strerror}"
        raise ContactLockingError(message) from error


def _tied(end: signal.Signals) -> Callable[[], None] | None:
    """Code for a child process: the system sends ``end`` to the child when this process ends."""
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is None:
        return None
    parent = os.getpid()

    def tie() -> None:
        prctl(_PR_SET_PDEATHSIG, int(end))
        if os.getppid() != parent:
            os._exit(1)

    return tie


def _stop(processes: Iterable[CaseProcess]) -> None:
    """Ask processes to end, and kill those that do not end in time."""
    running = list(processes)
    for process in running:
        process.send(signal.SIGTERM)
    deadline = time.monotonic() + _GRACE_SECONDS
    try:
        while not all([process.ended() for process in running]) and time.monotonic() < deadline:
            time.sleep(0.02)
    finally:
        # Also if the wait was interrupted.
        for process in running:
            process.send(signal.SIGKILL)
