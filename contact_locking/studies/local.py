"""Cases as processes on this machine, each of one rank or of several under mpirun."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Iterable, Mapping, Sequence

from contact_locking.errors import ContactLockingError

from .case_command import command, environment, explain
from .cases import Case
from .executor import Plan
from .outcome import LOG, begin
from .processes import tied
from .workers import Worker, WorkerCase

# mpirun has this time to end its ranks.
_GRACE_SECONDS = 10.0


class LocalExecutor:
    """Runs J cases at a time.  On Linux they end with this process, in whatever way it ends.

    Cases of one rank share processes that stay, one case after the other.
    """

    pause = 0.05

    def __init__(self, cases: Sequence[Case], plan: Plan) -> None:
        self._plan = plan
        self._environment = environment(plan.jobs, plan.ranks)
        self._waiting = list(reversed(cases))
        self._idle = [Worker(self._environment) for _ in range(plan.jobs * plan.shares_processes)]
        self._working: dict[str, Worker] = {}
        self.running: list[CaseProcess | WorkerCase] = []

    @property
    def busy(self) -> bool:
        return bool(self._waiting or self.running)

    def poll(self) -> list[CaseProcess | WorkerCase]:
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

    def _start(self, case: Case) -> CaseProcess | WorkerCase:
        if self._idle:
            worker = self._working[case.name] = self._idle.pop()
            return worker.start(case)
        words = command(case, self._plan.program, self._plan.ranks)
        return CaseProcess(case, words, self._environment, self._plan.ranks > 1)


class CaseProcess:
    """A running case; ``launched`` says that mpirun runs it."""

    def __init__(
        self, case: Case, command: Sequence[str], environment: Mapping[str, str], launched: bool
    ) -> None:
        self.case = case
        self._began = time.monotonic()
        # A killed mpirun could not end its ranks; SIGTERM makes mpirun end them.
        end = signal.SIGTERM if launched else signal.SIGKILL
        with (case.folder / LOG).open("wb") as log:
            try:
                self._process = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    env=environment,
                    # Ctrl-C on the terminal reaches this process only, which then stops the cases.
                    process_group=0,
                    preexec_fn=tied(end),
                )
            except OSError as error:
                message = f"a case cannot be started: {command[0]}: {error.strerror}"
                raise ContactLockingError(message) from error

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._began

    def ended(self) -> bool:
        return self._process.poll() is not None

    def why(self) -> str:
        return explain(self._process.returncode, self.case.folder / LOG)

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the process and its children, also after the process has ended."""
        try:
            os.killpg(self._process.pid, number)
        except ProcessLookupError:
            return
        except PermissionError:  # macOS, for a process that has ended
            return


def _stop(processes: Iterable[CaseProcess | WorkerCase]) -> None:
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
