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
from collections.abc import Callable, Mapping, Sequence
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
        variables = environment(plan.jobs, plan.ranks)
        self._waiting = list(reversed(cases))
        self._idle = [Slot(plan, variables) for _ in range(plan.jobs)]
        self.running: list[Slot] = []

    @property
    def busy(self) -> bool:
        return bool(self._waiting or self.running)

    def start(self) -> None:
        """Begin cases that wait, as many as may run.  Raises ContactLockingError."""
        while self._waiting and self._idle:
            self._idle[-1].start(self._waiting.pop())
            self.running.append(self._idle.pop())

    def poll(self) -> list[Slot]:
        """The cases that have ended."""
        ended = [slot for slot in self.running if slot.ended()]
        self.running = [slot for slot in self.running if slot not in ended]
        self._idle += ended
        return ended

    def stop(self) -> None:
        """Ask the cases to end, and kill those that do not end in time."""
        for slot in self.running:
            slot.send(signal.SIGTERM)
        deadline = time.monotonic() + _GRACE_SECONDS
        try:
            while not all(s.ended() for s in self.running) and time.monotonic() < deadline:
                time.sleep(0.02)
        finally:
            # Also if the wait was interrupted.
            for slot in self.running:
                slot.send(signal.SIGKILL)
        for slot in self._idle:
            slot.finish()


class Slot:
    """A place for one case at a time: its worker, or a process for each case."""

    case: Case

    def __init__(self, plan: Plan, variables: Mapping[str, str]) -> None:
        self._plan, self._variables = plan, variables
        self._process: subprocess.Popen[bytes] | None = None
        self._cases = 0

    def start(self, case: Case) -> None:
        """Prepare the folder of a case and begin it.  Raises ContactLockingError, and OSError."""
        begin(case)
        self.case, self._code, self._began = case, None, time.monotonic()
        log = case.folder / LOG
        if not self._plan.shares_processes:
            program = command(case, self._plan.program, self._plan.ranks)
            # A killed mpirun could not end its ranks; SIGTERM makes mpirun end them.
            end = signal.SIGTERM if self._plan.ranks > 1 else signal.SIGKILL
            how = {"stdin": subprocess.DEVNULL, "stderr": subprocess.STDOUT}
            with log.open("wb") as stream:
                self._process = self._started(program, end, stdout=stream, **how)
            return
        process = self._process
        if process is None or process.poll() is not None or self._cases >= _MOST_CASES:
            self.finish()
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
            process = self._started(_PROGRAM, signal.SIGKILL, stderr=subprocess.DEVNULL, **pipes)
            assert process.stdout is not None
            os.set_blocking(process.stdout.fileno(), False)
            self._process, self._cases = process, 0
        self._cases += 1
        log.touch()
        order = json.dumps([str(log), *words(case)])
        assert process.stdin is not None
        # Where the process has just ended, the case ends with the code of the process.
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(f"{order}\n".encode())
            process.stdin.flush()

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._began

    def ended(self) -> bool:
        if self._code is None and self._process is not None:
            # The end is asked for first: an answer of a worker may come just before it.
            self._code = self._process.poll()
            answers = self._process.stdout
            if answers is not None and (answer := answers.readline()):
                self._code = int(answer)
        return self._code is not None

    def why(self) -> str:
        assert self._code is not None
        return explain(self._code, self.case.folder / LOG)

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the process and its children, also after the process has ended."""
        # macOS raises PermissionError for a process that has ended.
        with contextlib.suppress(ProcessLookupError, PermissionError):
            if self._process is not None:
                os.killpg(self._process.pid, number)

    def finish(self) -> None:
        """Let the worker end, which has no case."""
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()

    def _started(
        self, program: Sequence[str], end: signal.Signals, **streams: Any
    ) -> subprocess.Popen[bytes]:
        """A process that gets the signal ``end`` when this one ends.

        Ctrl-C on the terminal reaches this process only, which then stops the cases.
        """
        how: dict[str, Any] = {"env": self._variables, "process_group": 0, "preexec_fn": _tied(end)}
        try:
            return subprocess.Popen(program, **how, **streams)
        except OSError as error:
            message = f"a case cannot be started: {program[0]}: {error.strerror}"
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
