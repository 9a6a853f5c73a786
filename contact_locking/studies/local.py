"""Cases as processes on this machine, each of one rank or of several under mpirun."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterable, Mapping, Sequence

from contact_locking.errors import ContactLockingError

from .case_command import command, environment, explain
from .cases import Case
from .executor import Plan
from .outcome import LOG, begin

# mpirun ends its ranks when it is asked to end; it gets this long.
_GRACE_SECONDS = 10.0
_PR_SET_PDEATHSIG = 1


class LocalExecutor:
    """J cases at a time.  They end when this process ends, however that happens (on Linux)."""

    pause = 0.1

    def __init__(self, cases: Sequence[Case], plan: Plan) -> None:
        self._plan = plan
        self._environment = environment(plan.jobs, plan.ranks)
        self._waiting = list(reversed(cases))
        self.running: list[CaseProcess] = []

    @property
    def busy(self) -> bool:
        return bool(self._waiting or self.running)

    def poll(self) -> list[CaseProcess]:
        ended = [process for process in self.running if process.ended()]
        self.running = [process for process in self.running if process not in ended]
        while self._waiting and len(self.running) < self._plan.jobs:
            case = self._waiting.pop()
            begin(case)
            words = command(case, self._plan.program, self._plan.ranks)
            self.running.append(CaseProcess(case, words, self._environment, self._plan.ranks > 1))
        return ended

    def stop(self) -> None:
        _stop(self.running)


class CaseProcess:
    """A running case; ``launched`` if by mpirun."""

    def __init__(
        self, case: Case, command: Sequence[str], environment: Mapping[str, str], launched: bool
    ) -> None:
        self.case = case
        self._began = time.monotonic()
        # A process that is killed cannot end its ranks, so mpirun has to be asked.
        end = signal.SIGTERM if launched else signal.SIGKILL
        with (case.folder / LOG).open("wb") as log:
            try:
                self._process = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    env=environment,
                    # Out of reach of the terminal's Ctrl-C, which is passed on in another way.
                    process_group=0,
                    preexec_fn=_tie(end),
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
        """A signal to all of it; after its end to what it may have left."""
        try:
            os.killpg(self._process.pid, number)
        except ProcessLookupError:
            return
        except PermissionError:  # macOS, for a process that has ended
            return


def _stop(processes: Iterable[CaseProcess]) -> None:
    """Ask processes to end, and kill those that do not."""
    running = list(processes)
    for process in running:
        process.send(signal.SIGTERM)
    deadline = time.monotonic() + _GRACE_SECONDS
    try:
        while not all([process.ended() for process in running]) and time.monotonic() < deadline:
            time.sleep(0.02)
    finally:
        # Also where the wait was interrupted.
        for process in running:
            process.send(signal.SIGKILL)


def _tie(end: signal.Signals) -> Callable[[], None] | None:
    """What a child does before its program starts, so that it gets a signal when this one ends."""
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is None:
        return None
    parent = os.getpid()

    def tie() -> None:
        prctl(_PR_SET_PDEATHSIG, int(end))
        if os.getppid() != parent:
            os._exit(1)

    return tie
