"""A case that runs as a process of its own, or as several under mpirun."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from contact_locking.errors import InputError

from .cases import Case
from .outcome import LOG, PARAMETERS, PROGRESS

#: What solves a case; the words of the command line follow.
PROGRAM = (sys.executable, "-m", "contact_locking")

# mpirun ends its ranks when it is asked to end; it gets this long.
_GRACE_SECONDS = 10.0
_LOG_TAIL = 65_536
# An error as the command line prints it: its further lines are indented.
_ERROR = re.compile(r"^error: (.+(?:\n {7}.+)*)", re.MULTILINE)
_PR_SET_PDEATHSIG = 1


def launcher(ranks: int) -> tuple[str, ...]:
    """The words before a program that start it on several ranks; none for one.

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
    """The environment of the cases; what the user has set is left alone."""
    defaults = {"PYTHONUNBUFFERED": "1"}
    if jobs * ranks > 1:
        defaults["OMP_NUM_THREADS"] = "1"
    if jobs > 1 and ranks > 1:
        # Each mpirun of Open MPI 4 and 5 would bind its ranks to the same first cores.
        defaults["OMPI_MCA_hwloc_base_binding_policy"] = "none"
        defaults["PRTE_MCA_hwloc_default_binding_policy"] = "none"
    return defaults | os.environ


def command(case: Case, program: Sequence[str] = PROGRAM) -> list[str]:
    """The command that solves a case in its folder, once `outcome.begin` has prepared it."""
    progress = str(case.folder / PROGRESS)
    return [*program, "run", str(case.folder / PARAMETERS), "--progress", progress]


class CaseProcess:
    """A running case.  It ends when this process ends, however that happens (on Linux)."""

    def __init__(self, case: Case, command: Sequence[str], environment: dict[str, str]) -> None:
        self.case = case
        self.began = time.monotonic()
        # A process that is killed cannot end its ranks, so mpirun has to be asked.
        several = len(command) > 0 and Path(command[0]).name == "mpirun"
        end = signal.SIGTERM if several else signal.SIGKILL
        with (case.folder / LOG).open("wb") as log:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment,
                # Out of reach of the terminal's Ctrl-C, which this process passes on in its way.
                process_group=0,
                preexec_fn=_tie(end),
            )

    def ended(self) -> bool:
        return self._process.poll() is not None

    @property
    def seconds(self) -> float:
        return time.monotonic() - self.began

    def why(self) -> str:
        """Why it left no results, after it has ended."""
        return explain(self._process.returncode, self.case.folder / LOG)

    def send(self, number: signal.Signals) -> None:
        """A signal to all of it; after its end to what it may have left."""
        try:
            os.killpg(self._process.pid, number)
        except ProcessLookupError:
            return
        except PermissionError:  # macOS, for a process that has ended
            return


def stop(running: Iterable[CaseProcess]) -> None:
    """Ask processes to end, and kill those that do not."""
    processes = list(running)
    for process in processes:
        process.send(signal.SIGTERM)
    deadline = time.monotonic() + _GRACE_SECONDS
    try:
        while not all([process.ended() for process in processes]) and time.monotonic() < deadline:
            time.sleep(0.02)
    finally:
        # Also where the wait was interrupted.
        for process in processes:
            process.send(signal.SIGKILL)


def explain(code: int, log: Path) -> str:
    """The reason for an exit code in words, from what the process has said if it has."""
    number = -code if code < 0 else code - 128
    if number in signal.valid_signals():
        name = signal.Signals(number).name
        hint = ", perhaps for want of memory" if number == signal.SIGKILL else ""
        return f"was killed by {name}{hint}"
    with log.open("rb") as stream:
        stream.seek(max(0, log.stat().st_size - _LOG_TAIL))
        text = stream.read().decode("utf-8", errors="replace")
    if code and (errors := _ERROR.findall(text)):
        return " ".join(errors[-1].split())
    if code in (0, 3):
        return "left no results of these parameters; has the mesh file changed meanwhile?"
    return f"ended with exit code {code}; see {log}"


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
