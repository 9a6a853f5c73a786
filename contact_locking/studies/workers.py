"""Processes that stay and solve one case after the other.

A case that crashes ends its process, with the same traces as a process of its own, and the next
case gets a new one.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from typing import IO

from contact_locking.errors import ContactLockingError

from .case_command import explain, words
from .cases import Case
from .outcome import LOG
from .processes import tied

_PROGRAM = (sys.executable, "-P", "-m", "contact_locking.command.worker")
# A process is replaced after so many cases, so that no leak of memory adds up.
_MOST_CASES = 100


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
            process = self._process = self._begin()
            self._cases = 0
        self._cases += 1
        log = case.folder / LOG
        log.touch()
        order = json.dumps([str(log), *words(case)])
        assert process.stdin is not None and process.stdout is not None
        # Where the process has just ended, the case ends with the code of the process.
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(f"{order}\n".encode())
            process.stdin.flush()
        return WorkerCase(case, process, process.stdout)

    def finish(self) -> None:
        """Let the process end, which has no case."""
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()
            self._process = None

    def _begin(self) -> subprocess.Popen[bytes]:
        try:
            process = subprocess.Popen(
                _PROGRAM,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=self._environment,
                process_group=0,
                preexec_fn=tied(signal.SIGKILL),
            )
        except OSError as error:
            message = f"a case cannot be started: {_PROGRAM[0]}: {error.strerror}"
            raise ContactLockingError(message) from error
        assert process.stdout is not None
        os.set_blocking(process.stdout.fileno(), False)
        return process


class WorkerCase:
    """A case that a worker solves."""

    def __init__(self, case: Case, process: subprocess.Popen[bytes], answers: IO[bytes]) -> None:
        self.case = case
        self._process, self._answers = process, answers
        self._began = time.monotonic()
        self._code: int | None = None

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._began

    def ended(self) -> bool:
        if self._code is None:
            # The end is asked for first: an answer may come just before it.
            code = self._process.poll()
            answer = self._answers.readline()
            self._code = int(answer) if answer else code
        return self._code is not None

    def why(self) -> str:
        assert self._code is not None
        return explain(self._code, self.case.folder / LOG)

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the process and its children, also after the process has ended."""
        try:
            os.killpg(self._process.pid, number)
        except (ProcessLookupError, PermissionError):
            return
