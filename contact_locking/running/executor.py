"""Solves cases by processes of this machine, each of one rank or of several under mpirun.

Cases of one rank share processes that stay, the workers.  A case that crashes ends its worker, with
the same traces as a process of its own, and the next case gets a new one.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from contact_locking.errors import ContactLockingError, InputError
from contact_locking.results.folder import PARAMETERS
from contact_locking.running.cases import LOG, Case, begin

#: The program that solves a case; its arguments follow.  With -P, Python takes no modules from the
#: current folder, which may have come with the study.
PROGRAM = (sys.executable, "-P", "-m", "contact_locking")

_LOG_TAIL = 65_536
# An error as the command line prints it: its further lines are indented.
_ERROR = re.compile(r"^error: (.+(?:\n {7}.+)*)", re.MULTILINE)
# PETSc catches signals, prints this message and ends with an exit code of its own.
_CRASH = re.compile(r"PETSC ERROR: Caught signal number \d+ ([^,\n]+)")
# mpirun has this time to end its ranks.
_GRACE_SECONDS = 10.0
_WORKER = (sys.executable, "-P", "-c", "from contact_locking.command import cli; cli.work()")
# A worker is replaced after so many cases, so that no leak of memory adds up.
_MOST_CASES = 100
_PR_SET_PDEATHSIG = 1


def launcher(ranks: int) -> tuple[str, ...]:
    """The words before a program that start it on ``ranks`` ranks; none for one rank.

    Raises InputError if there is no mpirun.
    """
    if ranks == 1:
        return ()
    mpirun = shutil.which("mpirun")
    if mpirun is None:
        raise InputError(
            f"--ranks {ranks} takes mpirun, which is not on the PATH; "
            "install MPI, or leave --ranks out"
        )
    return (mpirun, "-n", str(ranks))


def environment(jobs: int, ranks: int) -> dict[str, str]:
    """The environment variables of the cases; variables that the user has set stay."""
    defaults = {"PYTHONUNBUFFERED": "1"}
    if jobs * ranks > 1:
        defaults["OMP_NUM_THREADS"] = "1"
    if jobs > 1 and ranks > 1:
        # Each mpirun of Open MPI 4 and 5 would bind its ranks to the same first cores.
        defaults["OMPI_MCA_hwloc_base_binding_policy"] = "none"
        defaults["PRTE_MCA_hwloc_default_binding_policy"] = "none"
    return defaults | os.environ


def words(case: Case) -> list[str]:
    """The arguments that solve a case in its folder, once `begin` has prepared it."""
    return ["run", str(case.folder / PARAMETERS)]


def end_of(log: Path) -> str:
    """The end of the log of a case, as far as it is there."""
    with contextlib.suppress(OSError), log.open("rb") as stream:
        stream.seek(max(0, log.stat().st_size - _LOG_TAIL))
        return stream.read().decode("utf-8", errors="replace")
    return ""


def explain(code: int, log: Path) -> str:
    """The reason for an exit code in words, taken from the log of the process if it is there."""
    number = -code if code < 0 else code - 128
    if number in list(signal.Signals):
        name = signal.Signals(number).name
        hint = ", perhaps for want of memory" if number == signal.SIGKILL else ""
        return f"was killed by {name}{hint}"
    text = end_of(log)
    if code and (crash := _CRASH.search(text)):
        return f"crashed: {crash[1]}; see {log}"
    if code and (errors := _ERROR.findall(text)):
        return " ".join(errors[-1].split())
    if code in (0, 3):
        return "left no results of these parameters; has the mesh file changed meanwhile?"
    return f"ended with exit code {code}; see {log}"


@dataclass(frozen=True)
class Plan:
    """How many cases are solved at a time, on how many ranks each, and by which program."""

    jobs: int = 1
    ranks: int = 1
    program: Sequence[str] = PROGRAM

    @property
    def shares_processes(self) -> bool:
        """Whether processes that stay solve the cases, each several of them."""
        return self.ranks == 1 and self.program == PROGRAM


class Executor:
    """Runs J cases at a time.  On Linux they end with this process, in whatever way it ends."""

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
        self._cases, self._began = 0, 0.0
        self._code: int | None = None

    def start(self, case: Case) -> None:
        """Prepare the folder of a case and begin it.  Raises ContactLockingError, and OSError."""
        begin(case)
        self.case, self._began = case, time.monotonic()
        self._code = None
        log = case.folder / LOG
        if not self._plan.shares_processes:
            program = [*launcher(self._plan.ranks), *self._plan.program, *words(case)]
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
            process = self._started(_WORKER, signal.SIGKILL, stderr=subprocess.DEVNULL, **pipes)
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
